"""Watchdogs of the loop for skin without new frames, stalls of the process, signals and failed threads. The
module also configures Python's garbage collector.
"""

from __future__ import annotations

import gc
import logging
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType

import numpy as np

from tci.drivers.driver import Driver
from tci.messages import Contacts, JointReading, Reading
from tci.messages.clock import Clock
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.runtime.moment import Moment

Watchdog = Callable[[Moment], Reason | None]
"""Asked in each period of a loop; returns a reason to hold the robot in this period, or None."""

MISSED = 3
"""Least number of successive missed periods at which the robot holds: without real-time priority, a few are
normal."""
PERIODS = 3.0
"""Number of frame periods without a frame after which a patch counts as silent. Assumed: one or two
successive frames may be lost."""
LEAST_SILENCE = 0.25
"""Lower bound [s] on the time without a frame after which a patch counts as silent. Assumed: a busy network
delays data by less than this time."""
MOVED = 2e-3
"""Angle [rad] by which a joint must have turned since its last new torque to count as moving. Assumed: larger
than one count of an encoder, by which a joint at rest may still settle while all torques stay equal."""
MOST_FORCE = 150.0
"""Largest force [N] of a touch that is estimated from joint torques, above which the robot holds. Assumed:
people push an arm with less force. A larger estimate means that the torques do not fit the description."""
_log = logging.getLogger("tci")
SIGNALS = (signal.SIGINT, signal.SIGTERM)
TURN = 0.0001
"""Time [s] after which Python switches between busy threads. Assumed: far shorter than a control period.
Python's default is 5 ms."""
STOOD = 0.3
"""Time [s] between two periods above which the process counts as stalled. Assumed: delays that other programs
cause are shorter."""
PILED_UP = 0.3
"""Time [s] for which the robot holds after a stall, while the loop reads all queued data. Assumed: the loop
reads the queued data in less than this time."""
FROZEN_BY_PYTHON = 1000
"""If more objects than this number are frozen (`gc.freeze`), the user's program has frozen objects of its
own. Python 3.12 itself freezes 375 objects. A program that calls `gc.freeze` freezes thousands."""


@contextmanager
def attentive() -> Iterator[None]:
    """Makes Python switch threads after `TURN` [s] inside the `with` block, so that other threads also run
    while the loop computes."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, TURN))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def usual_watchdogs(driver: Driver, needed: Collection[str] | None = None) -> tuple[Watchdog, ...]:
    """The watchdogs of a robot that touches move: missed periods, skin or torques that have gone silent, and
    joint torques that no touch explains. `needed` names the patches that what runs needs; None is all."""
    robot, info = driver.robot, driver.info
    skin = SkinWatchdog(
        robot, stale_after=driver.gate.stale_after, keep_alive=info.keep_alive, without=info.sources
    )
    sources = SourceWatchdog(robot, info.sources, needed)
    return (
        missed_periods,
        lambda moment: skin.fault(moment.reading, moment.now),
        lambda moment: sources.fault(moment.reading),
        lambda moment: implausible_force(moment.perception.contacts) if moment.perception else None,
    )


def missed_periods(moment: Moment) -> Reason | None:
    """Holds the robot after `MISSED` or more missed periods."""
    if moment.missed < MISSED:
        return None
    return Reason(Code.PERIODS_MISSED, f"the loop missed {moment.missed} periods")


class SkinWatchdog:
    """Detects skin that has stopped sending frames while joint data still arrives.

    Without skin frames, the robot does not measure touches.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        stale_after: float,
        keep_alive: float | None = None,
        without: Collection[str] = (),
    ) -> None:
        """Prepares the watchdog. `stale_after` [s] is the age above which joint data counts as too old. The
        patches in `without` may be silent (`SourceWatchdog` looks at them). If a
        patch sends frames only when values change (send-on-delta), `keep_alive` [s] is required: the longest
        time between two frames of a patch.
        """
        least = max(stale_after, LEAST_SILENCE, PERIODS * (keep_alive or 0.0))
        self._longest = {patch.name: max(PERIODS / patch.rate, least) for patch in robot.patches}
        self._longest |= dict.fromkeys(without, np.inf)
        self._last_frames: dict[str, tuple[int, float]] = {}
        self._soonest, self._quiet = np.inf, ""
        self._torques = TorqueWatchdog(robot, stale_after=stale_after)

    def fault(self, reading: Reading, now: float) -> Reason | None:
        """Returns a reason to hold the robot if a patch has sent no new frame for too long, or if the joints
        of a part have reported no new torques for too long. Otherwise returns None. `now` [s] is the present
        time.
        """
        fresh = False
        for frame in reading.skin:
            before = self._last_frames.get(frame.patch)
            if before is None or before[0] != frame.sequence:
                self._last_frames[frame.patch], fresh = (frame.sequence, now), True
        if fresh:
            self._soonest, self._quiet = min(
                (
                    (arrival + self._longest.get(patch, np.inf), patch)
                    for patch, (_, arrival) in self._last_frames.items()
                ),
                default=(np.inf, ""),
            )
        if now <= self._soonest:
            return self._torques.fault(reading.joints, now)
        silent = (now - self._last_frames[self._quiet][1]) * 1e3
        return Reason(Code.SKIN_SILENT, f"the skin of {self._quiet} has sent nothing for {silent:.0f} ms")


class SourceWatchdog:
    """Detects patches whose source is silent: their frame is empty. One that nobody needs is
    blind: it is told once, feels nothing until it comes back, and the rest goes on."""

    def __init__(
        self, robot: Robot, sources: Mapping[str, str], needed: Collection[str] | None = None
    ) -> None:
        """`sources` are addresses by patch; `needed` names the patches that hold the robot, None is all."""
        self._parts = {patch.name: patch.part for patch in robot.patches if patch.name in sources}
        self._sources, self._needed = sources, sources.keys() if needed is None else needed
        self._known: dict[str, int] = {}
        self.blind: set[str] = set()
        """Patches that feel nothing now."""

    def fault(self, reading: Reading) -> Reason | None:
        """Returns a reason to hold the robot while a patch that is needed is blind. Logs each patch that
        becomes blind, or feels again."""
        fresh = [
            frame
            for frame in reading.skin
            if frame.patch in self._parts and self._known.get(frame.patch) != frame.sequence
        ]
        if fresh:
            before = set(self.blind)
            for frame in fresh:
                self._known[frame.patch] = frame.sequence
                (self.blind.add if frame.empty else self.blind.discard)(frame.patch)
            self._tell(before)
        if not self.blind:
            return None
        missing = sorted(self.blind.intersection(self._needed))
        if not missing:
            return None
        return Reason(Code.SKIN_SILENT, f"{_from(self._sources, missing)} sends nothing usable")

    def _tell(self, before: set[str]) -> None:
        if gone := self.blind - before:
            for source in dict.fromkeys(self._sources[patch] for patch in sorted(gone)):
                own = sorted(patch for patch in gone if self._sources[patch] == source)
                if any(self._sources[patch] == source for patch in before):
                    continue  # its pads fall silent one after the other: told once
                parts = ", ".join(dict.fromkeys(self._parts[patch] for patch in own))
                _log.warning(
                    "%s sends nothing usable: it feels nothing until it comes back, and a push on %s is "
                    "noticed by joints only, as on a part without skin", _from(self._sources, own), parts,
                )  # fmt: skip
        for source in dict.fromkeys(self._sources[patch] for patch in sorted(before - self.blind)):
            if not any(self._sources[patch] == source for patch in self.blind):
                _log.warning("%s feels again", source)


def _from(sources: Mapping[str, str], patches: list[str]) -> str:
    more = f" and {len(patches) - 1} more" if len(patches) > 1 else ""
    return f"{patches[0]}{more} of {sources[patches[0]]}"


class TorqueWatchdog:
    """Detects joints that no longer report torques.

    Robots that detect touches by joint torques need this watchdog. Torques that stay exactly constant while
    the joints move do not count as new.
    """

    def __init__(self, robot: Robot, *, stale_after: float) -> None:
        """Prepares the watchdog. `stale_after` [s] is the age above which joint data counts as too old."""
        self._longest = max(stale_after, LEAST_SILENCE)
        felt = [patch for patch in robot.patches if patch.through_joints]
        self._patches = {part: [p.name for p in felt if p.part == part] for part in {p.part: 0 for p in felt}}
        self._servos = {
            part: np.array([one.servo for one in robot.part(part).servos if one.servo is not None], np.intp)
            for part in self._patches
        }
        self._seen: dict[str, tuple[Array, Array, float]] = {}
        self._stamp = -np.inf
        self._missed = np.nan

    def fault(self, joints: JointReading, now: float) -> Reason | None:
        """Returns a reason to hold the robot if a part has reported no new torques for too long. Otherwise
        returns None. Logs each part that has never reported any. `now` [s] is the present time.
        """
        if joints.stamp != self._stamp and joints.torque is not None:
            for part, servos in self._servos.items():
                torque, position = joints.torque[servos], joints.position[servos]
                before = self._seen.get(part)
                reported = np.isfinite(torque)
                if before is None or not np.array_equal(torque, before[0], equal_nan=True):
                    start, frozen = position, False
                else:
                    start = before[1]
                    frozen = bool(np.any(np.abs(position - start)[reported] > MOVED))
                if reported.any() and not frozen:
                    self._seen[part] = torque, start, now
        self._stamp = joints.stamp
        if np.isnan(self._missed):
            self._missed = now + self._longest
        elif now > self._missed:
            self._missed = np.inf
            for part in sorted(self._servos.keys() - self._seen.keys()):
                patches = ", ".join(self._patches[part])
                _log.warning(
                    "the joints of %s report no torques: %s feel nothing (tci doctor)", part, patches
                )
        for part, (_, _, latest) in self._seen.items():
            if (silent := now - latest) > self._longest:
                words = f"the joints of {part} have reported no new torques for {silent * 1e3:.0f} ms"
                return Reason(Code.SKIN_SILENT, f"{words}: {', '.join(self._patches[part])} feel nothing")
        return None


def implausible_force(contacts: Contacts) -> Reason | None:
    """Returns a reason to hold the robot if the force of a touch that is estimated from joint torques is
    implausible; otherwise None."""
    if not contacts:
        return None
    forces = np.where(contacts.certainty < 1.0, contacts.force, 0.0)
    if not (forces > MOST_FORCE).any():
        return None
    worst = contacts[int(np.argmax(forces))]
    return Reason(
        Code.SKIN_MISFIT,
        f"the joint torques of {worst.part} mean a push of {worst.force:.0f} N, above {MOST_FORCE:.0f} N; "
        "is the description that of this robot, with its hands and tools?",
    )


class StallDetector:
    """Detects that this process did not run for some time.

    During a stall, the process is frozen, swapped out, or without processor time. Data that arrives during a
    stall waits in the sockets and later looks new. Therefore the robot holds until the loop has read this
    data. The detector uses the machine's clock, since the clock of a simulation stops together with the
    process.
    """

    def __init__(self, clock: Clock, *, stale_after: float) -> None:
        """Starts the first period now. `stale_after` [s] is the age above which data counts as too old."""
        self._clock = clock
        self._longest = max(stale_after, STOOD)
        self._before = clock.now()
        self._until = -np.inf
        self._reason: Reason | None = None

    def fault(self) -> Reason | None:
        """Returns a reason to hold the robot after a stall, or None. Call this method once per period."""
        now = self._clock.now()
        stood, self._before = now - self._before, now
        if stood > self._longest:
            self._until = now + PILED_UP
            words = f"this process stood still for {stood * 1e3:.0f} ms"
            self._reason = Reason(Code.PROCESS_FROZEN, words)
        return self._reason if now < self._until else None


class Interruption:
    """A signal, or an exception in a thread, that ends the loop."""

    def __init__(self) -> None:
        self.signal: int | None = None
        """Number of the received signal. The value is None if no signal was received."""
        self.failure: BaseException | None = None
        """Exception that ended a thread. The value is None if no thread failed."""
        self.thread = ""
        """Name of the failed thread; empty if no thread failed."""
        self.rests = False
        """True while the loop brings the robot to rest. Signals do not interrupt this motion."""

    def raise_it(self) -> None:
        """Raises the exception that the signal or thread requires.

        SIGINT requires KeyboardInterrupt, any other signal SystemExit with the status 128 + signal, and a
        failed thread the exception that ended the thread.
        """
        if self.failure is not None:
            raise self.failure
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.signal is not None:
            raise SystemExit(128 + self.signal)


@contextmanager
def interruptions() -> Iterator[Interruption]:
    """Catches signals and the exceptions of all threads inside the `with` block. Signals are caught only if
    the block runs in the main thread. The first signal is only stored, so that the loop can bring the robot
    to rest. A second signal interrupts a capability that does not return, but never the motion to rest.
    """
    found = Interruption()

    def on_signal(number: int, frame: FrameType | None) -> None:
        if found.signal is not None and not found.rests:
            raise KeyboardInterrupt
        found.signal = number

    _watch_threads(found)
    here = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, on_signal) for number in SIGNALS} if here else {}
    try:
        yield found
    finally:
        _leave_threads(found)
        for number, handler in before.items():
            signal.signal(number, handler)


_threads = threading.Lock()
_watching: list[Interruption] = []
"""One object `Interruption` for each run in progress. There are several if loops of several robots run in
threads of one process."""
_hook = threading.excepthook


def _in_thread(raised: threading.ExceptHookArgs) -> None:
    if raised.exc_value is not None and raised.exc_type is not SystemExit:
        for found in _watching:
            if found.failure is None:
                found.failure = raised.exc_value
                found.thread = raised.thread.name if raised.thread else "a thread"
    _hook(raised)


def _watch_threads(found: Interruption) -> None:
    global _hook
    with _threads:
        if not _watching:
            _hook, threading.excepthook = threading.excepthook, _in_thread
        _watching.append(found)


def _leave_threads(found: Interruption) -> None:
    with _threads:
        _watching.remove(found)
        if not _watching:
            threading.excepthook = _hook


@contextmanager
def frozen_garbage() -> Iterator[None]:
    """Excludes all existing objects from garbage collection inside the `with` block. Otherwise, in a program
    with many objects, each garbage collection would stop the loop for a long time.
    """
    if gc.get_freeze_count() > FROZEN_BY_PYTHON:
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
