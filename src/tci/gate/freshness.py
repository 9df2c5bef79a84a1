"""Trust in the latest joint data, which decreases with its age. Torques are computed from this data."""

from __future__ import annotations

import math

from tci.messages import JointReading

LONGEST = 0.02
"""Largest age [s] at which data is fully trusted. Assumed: a constant braking torque needs about 50 ms to
reverse a joint, and robots send joint data at least every 10 ms."""
FADE = 0.01
"""Time [s] over which trust then falls to zero. Assumed: a light joint under its full torque gains a third of
its speed limit in this time."""
USUAL = 1.5
"""Data is trusted in full up to this factor times its usual largest age, plus a period. Assumed: jitter."""
SHARE = 0.1
"""Weight of each new age in the usual age. Assumed: a larger weight adapts faster to a slower network, a
smaller one is less affected by single delays."""


class Freshness:
    """Age of the latest valid data on the gate's own clock.

    Data is new if both its sequence number and its stamp are new. Repeated or reordered data is not new, even
    if its first copy was rejected.
    """

    def __init__(self, period: float) -> None:
        """Takes the `period` [s] of the control loop."""
        self._period = period
        self._usual = period
        self._stamp = self._newest = -math.inf
        self._sequence: int | None = None
        self._refused: int | None = None

    def see(self, joints: JointReading, now: float, *, believed: bool = True) -> bool:
        """Returns True if usable data is new at time `now` [s] and `believed`."""
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
        """Records a reading that can't be used, so that a repetition of it does not count as new."""
        self._refused = joints.sequence

    def age(self, now: float) -> float:
        """Returns the age [s] of the data at time `now` [s].

        It is infinite before any data, after time went back by more than a period, and for a time that is
        NaN.
        """
        age = now - self._stamp
        return max(age, 0.0) if -self._period <= age < math.inf else math.inf

    def trust(self, age: float) -> float:
        """Returns the trust (0..1) in data of an `age` [s]: 0 beyond LONGEST + FADE, usually earlier."""
        counts = min(self._period + USUAL * self._usual, LONGEST)
        return min(max(1.0 - (age - counts) / FADE, 0.0), 1.0)
