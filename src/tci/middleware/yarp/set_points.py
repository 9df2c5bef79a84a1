"""Streamed set-points: where a commander that sends them one after the other would come to rest.

A gate that went to each set-point itself would arrive there at rest, again and again, and lag behind. So
it goes where the stream would end if its sender braked now, as fast as the joints' limits of acceleration
and jerk let it; when nothing more comes, back to the last set-point. Only a stream that such a sender can
have made is led: its third differences are no larger than a limit of jerk allows.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from tci.frames import Array

ENDED = 0.1
"""Silence [s] after which a stream has ended. Ours."""
QUICKEST = 0.005
"""Time [s] that counts between two set-points at least: a lead that is too small only lags. Ours."""
SLOWLY = 0.05
"""Share of a new time between set-points in their mean: some that come together are no faster. Ours."""
SLACK = 1.25
"""How much larger than the limit of jerk allows a third difference may be: times jitter. Ours."""
SIGN = 0.05
"""Share of the limit of jerk by which an acceleration that falls counts as falling. Ours."""


class SetPoints:
    """The latest set-points of a board's joints [rad]."""

    def __init__(self, velocity: Array, acceleration: Array, jerk: Array) -> None:
        """Limits (n,) of the joints [rad/s], [rad/s2], [rad/s3]; NaN for joints that have none."""
        self._limits = np.array([velocity, acceleration, jerk])
        self._stream: tuple[list[int], list[Array], float, Array] = ([], [], 0.0, np.zeros(0))
        self._period, self._count, self._again = 0.0, 0, False
        # Replaced as a whole: connections and the loop come here from threads of their own.

    def lead(self, joints: Sequence[int], values: Array, here: Array, now: float | None = None) -> Array:
        """Where to go (k,) for set-points (k,) of these joints [rad] that came in now [s].

        `here` (m, k) [rad] is where the joints were just now; a new stream begins at one of these, at rest.
        """
        now = time.monotonic() if now is None else now
        before, kept, came, ahead = self._stream
        if list(joints) != before or now - came > ENDED:
            kept, self._period, self._count = [here[np.abs(values - here).max(axis=1).argmin()]] * 3, 0.0, 0
        else:
            self._count += 1
            self._period += (now - came - self._period) * max(SLOWLY, 1.0 / self._count)
        again = self._count > 0 and not self._again and np.array_equal(values, kept[-1])
        if not again:
            kept = [*kept[-3:], values]
            ahead = _ahead(np.array(kept), max(QUICKEST, self._period), *self._limits[:, list(joints)])
        self._again = again
        self._stream = list(joints), kept, now, ahead
        return values + ahead

    def last(self, now: float | None = None) -> tuple[list[int], Array] | None:
        """The joints and set-points of a stream that has ended ahead of itself; told once."""
        now = time.monotonic() if now is None else now
        joints, kept, came, ahead = self._stream
        if not ahead.any() or now - came <= ENDED:
            return None
        self._stream = joints, kept, came, np.zeros(0)
        return joints, kept[-1]

    def forget(self) -> None:
        """The robot holds: where the stream would have ended is nobody's wish any more."""
        self._stream = [], [], 0.0, np.zeros(0)


def _ahead(points: Array, period: float, velocity: Array, acceleration: Array, jerk: Array) -> Array:
    """How far (k,) [rad] beyond the last of four set-points (4, k) [rad] their sender comes to rest."""
    steps = np.diff(points, axis=0)
    way = np.sign(steps[2])
    first, second, third = way * steps / period
    most = jerk * period**2
    begins = (first == 0.0) & (second == 0.0)
    made = np.abs(third - 2.0 * second + first) <= SLACK * np.where(begins, most / 6.0, most)
    # Backward differences of second order: what has just begun may be slow, and is not led far.
    speed = 1.5 * third - 0.5 * second
    rising, before = (third - second) / period, (second - first) / period
    rise = 2.0 * rising - before
    # Who accelerates less goes on with that for a period at least: else it would be led too far each time.
    falls = np.clip((before - rising) / (SIGN * jerk * period), 0.0, 1.0)
    speed = speed - falls * (np.maximum(speed - third, 0.0) + most / 2.0)
    rise = rise - falls * jerk * period
    speed = np.clip(speed, 0.0, velocity)
    distance = stopping_distance(speed, np.clip(rise, -acceleration, acceleration), acceleration, jerk)
    return np.where(made & np.isfinite(distance), way * distance, 0.0)


def stopping_distance(speed: Array, rise: Array, acceleration: Array, jerk: Array) -> Array:
    """Way (k,) [rad] to rest from `speed` (k,) >= 0 [rad/s], whose acceleration is `rise` (k,) [rad/s2].

    The acceleration falls with `jerk` to no less than -`acceleration`, stays there, and rises to zero again.
    One that would take the speed through zero counts as what just does not.
    """
    rise = np.maximum(rise, -np.sqrt(2.0 * jerk * speed))
    brake = np.minimum(np.sqrt(jerk * speed + rise**2 / 2.0), acceleration)
    held = np.maximum(speed + rise**2 / (2.0 * jerk) - brake**2 / jerk, 0.0)
    steady = held / np.where(brake > 0.0, brake, 1.0)
    falling = (rise + brake) / jerk
    way = speed * falling + rise * falling**2 / 2.0 - jerk * falling**3 / 6.0
    speed = speed + rise * falling - jerk * falling**2 / 2.0
    way = way + speed * steady - brake * steady**2 / 2.0
    left = speed - brake * steady
    lasts = brake / jerk
    distance: Array = way + left * lasts - brake * lasts**2 / 2.0 + jerk * lasts**3 / 6.0
    return np.maximum(distance, 0.0)
