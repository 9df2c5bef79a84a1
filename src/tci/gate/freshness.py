"""Trust in the latest joint data, a number from 1 to 0 that decreases with the age of the data. In torque
mode, the gate multiplies each permitted torque by the trust, because torques are computed from the data."""

from __future__ import annotations

import math

from tci.messages import JointReading

LONGEST = 0.03
"""Largest age [s] at which joint data is fully trusted: data of 200 Hz that comes 14 ms late, with jitter."""
FADE = 0.01
"""Time [s] in which the trust in joint data (a factor of braking torques) falls from 1 to 0. The fall begins
when the data is too old to be fully trusted; torques that drive a joint end at once then, since each of them
adds energy that nobody sees."""
SHARE = 0.1
"""Weight of the newest value in a running mean of ages [s]. Each value is the age of the latest joint data at
the arrival of newer data. Assumed: a larger weight adapts faster to a slower network; a smaller weight is
less affected by single delays."""


SILENCE = 0.1
"""Age [s] of data at the arrival of newer data from which on this counts as a fault, and as no habit."""
FORGETS = 2.0
"""Time constant [s] in which the largest age is forgotten, so that a busy minute does not count for ever."""
KNOWN = 20
"""Number of arrivals from which on the largest age is known."""


class Freshness:
    """Age of the latest valid joint data, measured on the gate's own clock.

    Data is new if both its sequence number and its stamp are new. Repeated data, and data in the wrong order,
    is not new. Repeated data is not new even if its first copy was rejected.
    """

    def __init__(self, period: float) -> None:
        """Starts without data; `period` [s] is the period of the control loop."""
        self._period = period
        self._usual = period
        self._longest, self._arrivals = 0.0, 0
        self._stamp = self._newest = -math.inf
        self._sequence: int | None = None
        self._refused: int | None = None

    def see(self, joints: JointReading, now: float, *, believed: bool = True) -> bool:
        """Records usable joint data at time `now` [s]. Returns True if the data is new and `believed` is
        True. `believed` is False if the monitor has found the data untrustworthy."""
        if now < self._newest - self._period:  # the time went back
            self._stamp = self._newest = -math.inf
        if joints.sequence in (self._sequence, self._refused) or not self._newest < joints.stamp:
            return False
        self._newest, self._sequence = min(joints.stamp, now), joints.sequence
        if believed:
            self._learn(now - self._stamp)
            self._usual += SHARE * (min(now - self._stamp, LONGEST) - self._usual)
            self._stamp = self._newest
        return believed

    def _learn(self, age: float) -> None:
        if age > SILENCE:
            return
        self._arrivals += 1
        forgotten = min(age / FORGETS, 1.0) * (self._longest - age)
        self._longest = max(age, self._longest - forgotten)

    def overdue(self, age: float) -> bool:
        """True if data of this age [s] is older by a period than it lately became before newer data came."""
        return self._arrivals >= KNOWN and age > self._longest + self._period

    def refuse(self, joints: JointReading) -> None:
        """Records a reading that can't be used, so that the reading does not count as new if it is
        repeated."""
        self._refused = joints.sequence

    def age(self, now: float) -> float:
        """Returns the age [s] of the data at time `now` [s].

        The age is infinite if no data has arrived yet, if the time went back by more than a period, or if
        `now` is NaN.
        """
        age = now - self._stamp
        return max(age, 0.0) if -self._period <= age < math.inf else math.inf

    def trust(self, age: float) -> float:
        """Trust (0..1) in data of an `age` [s]: 1 until newer data is overdue by a period, 0 at any age above
        0.04 s (`LONGEST` + `FADE`)."""
        counts = min(self._period + self._usual, LONGEST)
        return min(max(1.0 - (age - counts) / FADE, 0.0), 1.0)
