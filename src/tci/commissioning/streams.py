"""How well data flows through a driver: rates, lost frames, ages, and what reading costs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tci.drivers.driver import Driver
from tci.frames import Array
from tci.messages import Reading


@dataclass(frozen=True, slots=True)
class Stream:
    """What was seen of one source of frames: the joints, or a patch of skin."""

    name: str
    """`joints`, or the patch's name."""
    expected: float | None
    """Frames per second [Hz] that the description promises; None for the joints."""
    frames: int
    """Different frames that were seen."""
    sent: int
    """Frames that the robot numbered in that time."""
    rate: float
    """Frames per second [Hz] that the robot numbered; 0 when there were fewer than two."""
    lost: int
    """Numbered frames that nobody saw although the driver was read often enough for all of them."""
    older: int
    """Frames that came after a newer one."""
    age: float
    """Median age [s] of the newest frame when it is read."""
    oldest: float
    """Largest age [s] of the newest frame when it is read."""

    def to_json(self) -> dict[str, object]:
        """Plain values; times in ms."""
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
        }


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A driver, read for a while."""

    streams: tuple[Stream, ...]
    """Joints first, then the patches of the description in their order."""
    readings: tuple[Reading, ...]
    """At most HISTORY readings, evenly over the time, the newest last."""
    cost: Array
    """How long each `read` took (n,) [s], on this machine's clock."""


HISTORY = 50
"""Readings that an observation keeps."""
ENOUGH = 1.5
"""A source is seen whole when the driver is read this many times as often as it sends. Ours."""


class _Count:
    """One source while it is watched."""

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
        """Raises nothing; a source that never sent anything has rate 0 and infinite age."""
        if not self.seen:
            return Stream(name, expected, 0, 0, 0.0, 0, self.older, np.inf, np.inf)
        (first, begin), (last, end) = self.seen[0], self.seen[-1]
        steps = last - first
        rate = steps / (end - begin) if end > begin else 0.0
        often = elapsed > 0.0 and reads / elapsed >= ENOUGH * rate
        lost = steps + 1 - len(self.seen) if often else 0
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
        )


def observe(
    driver: Driver, duration: float, *, progress: Callable[[float], None] | None = None
) -> Observation:
    """Read a driver once per period for `duration` [s]; `progress` is told the share 0..1 that is done.

    Nothing is commanded. Raises DriverError when the robot can't be read.
    """
    patches = {patch.name: patch.rate for patch in driver.robot.patches}
    joints, skin = _Count(), {name: _Count() for name in patches}
    cost: list[float] = []
    kept: list[Reading] = []
    every = max(1, int(duration / driver.period) // HISTORY)
    begin = before = None
    for now in driver.ticks(duration=duration):
        begin = now if begin is None else begin
        started = time.perf_counter()
        reading = driver.read()
        cost.append(time.perf_counter() - started)
        before = driver.clock.now()
        joints.add(reading.joints.sequence, reading.joints.stamp, before)
        for frame in reading.skin:
            if frame.patch in skin:
                skin[frame.patch].add(frame.sequence, frame.stamp, before)
        if len(cost) % every == 0:
            kept.append(reading)
        if progress is not None:
            progress(min(1.0, (now - begin) / duration))
    elapsed = before - begin if begin is not None and before is not None else 0.0
    streams = [joints.stream("joints", None, elapsed, len(cost))]
    streams += [skin[name].stream(name, rate, elapsed, len(cost)) for name, rate in patches.items()]
    return Observation(tuple(streams), tuple(kept[-HISTORY:]), np.array(cost))
