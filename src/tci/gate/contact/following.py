"""Which joints don't follow their references, and by how much: the sign that something holds them.

A joint that is held differs from one that lags: a lagging joint is where its reference was a moment ago, a
held one is nowhere on that way, or stands while its reference went on. How long a moment is, is learned: a
joint that lagged by 20 ms so far does not lag by 100 ms now. A joint of a moving group that nobody commands
should stay where it was when the group rested.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from tci.gate.contact.overloads import Overloads
from tci.gate.contact.overshoots import STANDS, Overshoots
from tci.gate.joint_monitor import Reference
from tci.gate.kernels.lags import find_lags, find_span, rows_at
from tci.messages import JointReading, Mode
from tci.messages.frames import Array

CLEAR = 0.35
"""Fraction of `held` below which nothing holds a joint for certain. Dry friction that bends a good servo by
half a degree is less."""
PROGRESS, SLOWEST, SHARE = 0.05, float(np.deg2rad(2.0)), 0.4
"""A joint stands if within `PROGRESS` [s] it went less than `SHARE` of the way that its reference went,
whatever its lag, and that way is at least `SLOWEST` [rad]: more than coarse encoders and friction explain."""
CREEPS = 0.5
"""Fraction of its reference's speed below which a joint may be held that goes there: somebody soft yields,
and the joint creeps on."""
OVERSHOOT = 0.1
"""Fraction of the way within the lag by which a servo of 60 rad/s and a damping of 0.7 overshoots when its
reference turns."""
LAGS = 21
"""Number of lags that are tried, from none to the longest: 5 ms apart by default."""
FAST = float(np.deg2rad(20.0))
"""Speed [rad/s] of a reference from which on a joint's lag is told from friction."""
SURE = 0.1
"""Time [s] after which a lag counts as that of a free joint, if no contact was noticed meanwhile."""
ENOUGH = 0.05
"""Time [s] for which a joint must have moved until its lag is known."""
MORE, LATER = 1.25, 0.012
"""Factor and time [s] by which a joint may lag more than it ever did: its reading or its order comes a period
later, its load is another."""


class History:
    """Rows with their times, oldest first, in one piece of memory: nothing is copied to look at them."""

    def __init__(self, width: int) -> None:
        self._times, self._rows = np.empty(64), np.empty((64, width))
        self._first, self._end = 0, 0

    def __len__(self) -> int:
        return self._end - self._first

    @property
    def times(self) -> Array:
        return self._times[self._first : self._end]

    @property
    def rows(self) -> Array:
        return self._rows[self._first : self._end]

    def append(self, time: float, row: Array) -> None:
        if self._end == len(self._times):  # back to the begin, with as much room again
            times, rows = self.times, self.rows
            room = 2 * len(times)
            if room > len(self._times):
                self._times, self._rows = np.empty(room), np.empty((room, self._rows.shape[1]))
            self._times[: len(times)], self._rows[: len(times)] = times, rows.copy()
            self._first, self._end = 0, len(times)
        self._times[self._end], self._rows[self._end] = time, row
        self._end += 1

    def forget(self, before: float = np.inf) -> None:
        """Forgets what is older than `before` [s], all by default, but keeps the last row before it."""
        if before == np.inf:
            self._first = self._end
        while len(self) > 2 and self._times[self._first + 1] < before:
            self._first += 1

    def at(self, times: Array) -> Array:
        """Rows (k, width) at `times` (k,), between the noted ones on a line."""
        found = np.empty((len(times), self._rows.shape[1]))
        rows_at(self.times, self.rows, times, found)
        return found


class Following:
    """Remembers references and readings of a robot's joints, and judges each new reading."""

    def __init__(self, count: int, *, held: float, lag: float, known: bool) -> None:
        """Judges `count` servos.

        Args:
            count: number of servos.
            held: angle [rad] from which on a joint counts as held.
            lag: longest time [s] by which a healthy joint follows.
            known: whether readings are so regular that a joint's own lag can be learned, and a standing joint
                be told from a late reading.
        """
        self._held, self._lag, self._known = held, lag, known
        self.side = np.zeros(count)
        """Where each joint pushes: 1 towards larger angles, -1 towards smaller ones."""
        self.pull = np.zeros(count)
        """Angle [rad] by which each joint is behind its reference; 0 if that is little."""
        self.runs = Overshoots(count)
        self.beyond = np.zeros(count, bool)
        """Joints outside their recent references by more than `held` that brake beyond them, or yield."""
        self._past = History(count)
        self._readings: deque[tuple[float, Array]] = deque()
        self._rests = np.full(count, np.nan)
        self._tried, self._few = np.linspace(0.0, lag, LAGS), np.linspace(0.0, lag, 6)
        self._places = np.empty(LAGS, np.intp)
        self._lags: deque[tuple[float, Array]] = deque()
        self._longest, self._moved = np.zeros(count), np.zeros(count)

    def forget(self) -> None:
        """After the clock went back: what was learned of the joints stays."""
        self._past.forget()
        self._readings.clear()
        self._lags.clear()
        self.runs.forget()

    @property
    def latest(self) -> float:
        """Time [s] of the latest reference; -inf if there is none."""
        return float(self._past.times[-1]) if self._past else -np.inf

    def remember(self, reference: Reference, now: float) -> None:
        """Notes the references at `now` [s]."""
        whole = np.full(len(self.side), np.nan)
        stiff = [mode is not Mode.TORQUE for mode in reference.modes]
        whole[reference.servos[stiff]] = reference.position[stiff]
        self._past.append(now, whole)
        self._past.forget(now - (self._lag + 2.0 * PROGRESS + 0.05))

    def rest(self, servos: NDArray[np.intp], joints: JointReading) -> None:
        """Notes where servos of a resting group are."""
        self._rests[servos] = joints.position[servos]

    @property
    def learned(self) -> NDArray[np.bool_]:
        """Joints (n_servos,) whose own lag is known."""
        known: NDArray[np.bool_] = self._moved >= ENOUGH
        return known

    @property
    def lags(self) -> Array:
        """Time (n_servos,) [s] by which a joint lags at most that nothing holds."""
        found: Array = np.where(self.learned, MORE * self._longest + LATER, self._lag)
        return found

    def learn(self, joints: JointReading, reference: Reference) -> None:
        """Notes by which time each joint lags whose reference moves; nothing was in contact for `SURE`."""
        if not self._known or not (np.abs(reference.velocity) > FAST).any():
            return
        past, lags = self._past, np.empty(len(self.side))
        find_lags(
            past.times, past.rows, joints.stamp, self._tried, joints.position, FAST, self._places, lags
        )  # fmt: skip
        self._lags.append((joints.stamp, lags))
        while joints.stamp - self._lags[0][0] > SURE:
            stamp, lags = self._lags.popleft()
            if self._lags:
                self._moved += min(self._lags[0][0] - stamp, 0.02) * np.isfinite(lags)
            np.fmax(self._longest, lags, out=self._longest)

    def doubt(self) -> None:
        """Something is in contact: what was seen of late teaches nothing."""
        self._lags.clear()

    def near(self, joints: JointReading, reference: Reference) -> bool:
        """True if every joint is so near its present reference that nothing can hold it."""
        behind = reference.position - joints.position[reference.servos]
        if behind.size and float(np.abs(behind).max()) >= 0.5 * self._held:
            return False
        rows = self._past.rows
        self.side = np.where(rows[-1] > joints.position, 1.0, -1.0)
        self.runs.look(joints, self.side, np.ones(len(self.side), bool), rows[-1] - rows[0])
        return True

    def error(self, joints: JointReading, reference: Reference, overloads: Overloads) -> Array:
        """Angle (n_servos,) [rad] of each joint outside its recent references, more than `held` if it stands
        while they went on; NaN for servos that follow no reference. 0 for those that yield to `overloads`."""
        since, there = self._read(joints)
        passed = joints.stamp - since
        times, rows = self._past.times, self._past.rows
        longest = self.lags + 0.5 * self._tried[1]
        tried = self._tried if self._known else np.empty(0)
        low, high = np.empty((2, len(longest)))
        find_span(times, rows, joints.stamp - self._lag, joints.stamp, tried, longest, low, high)
        outside = np.maximum(joints.position - high, low - joints.position)
        error: Array = np.maximum(outside - OVERSHOOT * (high - low), 0.0)
        side = np.where(joints.position < 0.5 * (low + high), 1.0, -1.0)
        passes = (outside <= 0.0) | (side != self.side)
        brakes = self.runs.look(joints, side, passes, rows[-1] - rows[0])
        self.side = side
        # a joint whose velocity says that it goes on is not held: its encoder is wrong, as the monitor tells
        goes = self.side * joints.velocity > STANDS
        goes[reference.servos] &= np.abs(joints.velocity[reference.servos]) > CREEPS * np.abs(
            reference.velocity
        )
        if self._known and PROGRESS <= passed < 2.0 * PROGRESS:
            now, then = self._past.at(joints.stamp - self._few), self._past.at(since - self._few)
            ways = now - then
            least = np.where(
                (ways > 0.0).all(axis=0) | (ways < 0.0).all(axis=0), np.abs(ways).min(axis=0), 0.0
            )
            gone = (joints.position - there) * np.sign(ways[0])
            # one that overshot waits until its reference has come past it
            late = (rows[-1] - joints.position) * np.sign(ways[0]) > CLEAR * self._held
            late &= (then[0] - there) * np.sign(ways[0]) >= 0.0
            stands = (least > SLOWEST) & (gone < SHARE * least) & late
            error[stands] = np.maximum(error, self._held + least - gone)[stands]
        yields = overloads.yields(self.side, joints.stamp) & np.isfinite(error)
        self.beyond = (brakes | yields) & (error > self._held)
        self.runs.note(self.beyond, joints.stamp)
        # whose references are too new to tell is not late yet
        error[goes | brakes | yields | (np.isnan(error) & np.isfinite(rows[-1]))] = 0.0
        pull = rows[-1] - joints.position
        # what lags goes the same way; a servo without reference pulls nowhere
        self.pull = np.where(np.abs(pull) >= 0.5 * CLEAR * self._held, pull, 0.0)
        return error

    def _read(self, joints: JointReading) -> tuple[float, Array]:
        """Notes a reading. Returns the time [s] and positions (n_servos,) [rad] of one that is `PROGRESS`
        older, or of the oldest."""
        self._readings.append((joints.stamp, joints.position))
        while joints.stamp - self._readings[1][0] >= PROGRESS if len(self._readings) > 2 else False:
            self._readings.popleft()
        return self._readings[0]

    def bent(self, joints: JointReading) -> Array:
        """Angle (n_servos,) [rad] by which joints that nobody commands left the place where they rested; NaN
        for servos that follow a reference, have no power, or were never seen at rest."""
        own = np.abs(joints.position - self._rests)
        if self._past:
            own[np.isfinite(self._past.rows[-1])] = np.nan
        if joints.powered is not None:
            own[~joints.powered] = np.nan
        bent: Array = own if self._known else np.full(len(own), np.nan)
        return bent
