"""How far the latest joint data can still be trusted where a torque is made from it."""

from __future__ import annotations

import math

from tci.messages import JointReading

LONGEST = 0.02
"""Age [s] up to which the latest data may count in full. Assumed: a joint under a fixed torque that is braked
needs some 50 ms until it goes the other way, and robots send their joints every 10 ms at least."""
FADE = 0.01
"""Time [s] in which trust ends from there. Assumed: a light joint under its full torque gains a third of its
speed limit in it."""
USUAL = 1.5
"""Data counts in full up to so many times the age that it usually reaches, and a period. Assumed: jitter."""
SHARE = 0.1
"""Share of each new age in the usual one. Assumed."""


class Freshness:
    """The age of the latest data that was new and believed, on the gate's own clock. It has memory.

    Data is new where its number and its stamp are: what repeats or comes in the wrong order is not, also
    where it was not believed when it came first.
    """

    def __init__(self, period: float) -> None:
        """`period` [s] of the control loop."""
        self._period = period
        self._usual = period
        self._stamp = self._newest = -math.inf
        self._sequence: int | None = None
        self._refused: int | None = None

    def see(self, joints: JointReading, now: float, *, believed: bool = True) -> bool:
        """Whether usable data is new at time `now` [s], and may be acted on."""
        if now < self._newest - self._period:  # time went back
            self._stamp = self._newest = -math.inf
        if joints.sequence in (self._sequence, self._refused) or not self._newest < joints.stamp:
            return False
        self._newest, self._sequence = min(joints.stamp, now), joints.sequence
        if believed:
            self._usual += SHARE * (min(now - self._stamp, LONGEST) - self._usual)
            self._stamp = self._newest
        return believed

    def refuse(self, joints: JointReading) -> None:
        """A reading can't be used: its number is not new any more."""
        self._refused = joints.sequence

    def age(self, now: float) -> float:
        """Age [s] of the data at time `now` [s]; infinite before there was any, where time went back by more
        than a period, and for a time that is none."""
        age = now - self._stamp
        return max(age, 0.0) if -self._period <= age < math.inf else math.inf

    def trust(self, age: float) -> float:
        """Share 0..1 by which data of an `age` [s] counts: none after LONGEST and FADE, and mostly before."""
        counts = min(self._period + USUAL * self._usual, LONGEST)
        return min(max(1.0 - (age - counts) / FADE, 0.0), 1.0)
