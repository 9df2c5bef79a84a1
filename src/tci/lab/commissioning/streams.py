"""Measures the data that a driver receives: frame rates, lost frames, ages of frames, and the duration of
`read`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tci.drivers.driver import Driver
from tci.gate.contact.trust import GAP
from tci.messages import Reading
from tci.messages.frames import Array
from tci.runtime.control import Control


@dataclass(frozen=True, slots=True)
class Stream:
    """Statistics of one source of frames: the joints, or a patch of skin."""

    name: str
    """Name of the patch, or "joints"."""
    expected: float | None
    """Nominal frame rate [Hz] in the description. The value is None for the joints."""
    frames: int
    """Number of different frames that were read."""
    sent: int
    """Number of frames that the robot sent during the observation, computed from sequence numbers."""
    rate: float
    """Rate [Hz] at which the robot sent frames, computed from sequence numbers and time stamps. The rate is 0
    if fewer than two frames arrived."""
    lost: int
    """Number of frames that the robot sent but that were not read. The number is 0 if `read` was called too
    seldom to count lost frames."""
    older: int
    """Number of frames that arrived after a newer frame."""
    age: float
    """Median, over all calls of `read`, of the age [s] of the newest frame."""
    oldest: float
    """Largest age [s] that the newest frame had in a call of `read`; infinite if no frame arrived."""
    gaps: int
    """Number of times that `GAP` times the usual time or more lay between two frames that were read."""

    def to_json(self) -> dict[str, object]:
        """Returns the statistics as JSON values. Ages are in [ms]."""
        return {
            "name": self.name,
            "rate_hz": self.rate,
            "expected_hz": self.expected,
            "frames": self.frames,
            "sent": self.sent,
            "lost": self.lost,
            "older": self.older,
            "age_ms": 1e3 * self.age,
            "oldest_ms": 1e3 * self.oldest,
            "gaps": self.gaps,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Readings of a driver during an observation, and statistics of the frames in the readings."""

    streams: tuple[Stream, ...]
    """Statistics of the joints, then statistics of the patches in the order of the description, without those
    that the address leaves out."""
    readings: tuple[Reading, ...]
    """At most 50 readings (HISTORY) at equal intervals, the newest last."""
    cost: Array
    """Duration (n,) [s] of each call of `read`, on this machine's clock."""


HISTORY = 50
"""Largest number of readings that `observe` stores, which limits the memory. Assumed: enough readings for
statistics of values."""
ENOUGH = 1.5
"""Frames that were not read count as lost only if there are at least this many `read` calls per frame.
Assumed: calls are irregular, so with fewer calls two frames may arrive between two calls although the robot
has no fault."""


class _Count:
    """Counts the frames of one data stream (the joints, or a patch) during an observation."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, float]] = []
        self.ages: list[float] = []
        self.older = 0

    def add(self, sequence: int, stamp: float, now: float) -> None:
        if self.seen and sequence < self.seen[-1][0]:
            self.older += 1
            return
        if not self.seen or sequence > self.seen[-1][0]:
            self.seen.append((sequence, stamp))
        self.ages.append(now - stamp)

    def stream(self, name: str, expected: float | None, elapsed: float, reads: int) -> Stream:
        """Returns the statistics of the counted frames of a patch or of the joints. Without any frame, the
        rate is 0 and the age is infinite."""
        if not self.seen:
            return Stream(name, expected, 0, 0, 0.0, 0, self.older, np.inf, np.inf, 0)
        (first, begin), (last, end) = self.seen[0], self.seen[-1]
        steps = last - first
        rate = steps / (end - begin) if end > begin else 0.0
        often = elapsed > 0.0 and reads / elapsed >= ENOUGH * rate
        lost = steps + 1 - len(self.seen) if often else 0
        between = np.diff([stamp for _, stamp in self.seen])
        return Stream(
            name,
            expected,
            len(self.seen),
            steps + 1,
            rate,
            lost,
            self.older,
            float(np.median(self.ages)),
            max(self.ages),
            int((between > GAP * np.median(between)).sum()) if between.size else 0,
        )


def observe(
    driver: Driver, duration: float, *, progress: Callable[[float], None] | None = None
) -> Observation:
    """Reads a driver once per period for the time `duration` [s], without commands to the robot.

    `progress` is called in each period with the fraction of the time that has passed, 0 to 1. Raises
    DriverError if the robot can't be read.
    """
    left_out = driver.info.left_out
    patches = {patch.name: patch.rate for patch in driver.robot.skin if patch.name not in left_out}
    joints, skin = _Count(), {name: _Count() for name in patches}
    cost: list[float] = []
    kept: list[Reading] = []
    every = max(1, int(duration / driver.period) // HISTORY)
    begin = before = None
    for moment in Control(driver, write=False).periods(duration=duration):
        now, reading = moment.now, moment.reading
        begin = now if begin is None else begin
        cost.append(moment.took)
        before = driver.clock.now()
        joints.add(reading.joints.sequence, reading.joints.stamp, before)
        for frame in reading.skin:
            if frame.patch in skin and not frame.empty:
                skin[frame.patch].add(frame.sequence, frame.stamp, before)
        if len(cost) % every == 0:
            kept.append(reading)
        if progress is not None:
            progress(min(1.0, (now - begin) / duration))
    elapsed = before - begin if begin is not None and before is not None else 0.0
    streams = [joints.stream("joints", None, elapsed, len(cost))]
    streams += [skin[name].stream(name, rate, elapsed, len(cost)) for name, rate in patches.items()]
    return Observation(tuple(streams), tuple(kept[-HISTORY:]), np.array(cost))
