"""The clock of a sender, seen from here, without trusting that the two agree."""

from __future__ import annotations

import math

JUMP = 1.0
"""By more than this [s] a stamp is before the last one, or its way shorter than any, where their clock was
set or the sender started anew; less means a message out of order, or a quicker way. Ours."""
WINDOW = 5.0
"""How long [s] the quickest way counts: clocks drift. A delay that lasts for two windows is the way's own.
Ours."""
FIRST = 20
"""Messages after which the difference changes slowly only. Ours."""
SLEW = 0.1
"""By so much of the time between two messages the difference may change: speeds stay true to this. Ours."""


class SourceClock:
    """Turns a sender's stamps into times of our own clock, and knows what is old.

    The shortest way that a message took lately counts as no time at all; what took longer is older by the
    difference. So data that was held up on the way is not taken for fresh, times between messages are those
    of the sender, and a jump of their clock has no effect.
    """

    def __init__(self) -> None:
        self.difference: float | None = None
        """Ours minus theirs [s]; None before the first message."""
        self._last = -math.inf
        self._least = self._next = math.inf
        self._since = -math.inf
        self._count = 0

    def place(self, stamp: float, arrival: float) -> float | None:
        """When something was measured [s, ours], stamped `stamp` [s, theirs] and here at `arrival` [s, ours].

        None for what is older than something before it, or the same again. A stamp of 0 says nothing: then
        it is the arrival that counts.
        """
        if not 0.0 < stamp < 1e12:  # also refuses NaN
            return arrival
        delay = arrival - stamp
        if self.difference is None or stamp < self._last - JUMP or delay < self._least - JUMP:
            self.difference = self._least = self._next = delay
            self._since, self._count = arrival, 0
        elif stamp <= self._last:
            return None
        self._least, self._next = min(self._least, delay), min(self._next, delay)
        if arrival - self._since > WINDOW:
            self._least, self._next, self._since = self._next, delay, arrival
        self._count += 1
        step = SLEW * max(0.0, stamp - self._last) if self._count > FIRST else math.inf
        self.difference += max(-step, min(step, self._least - self.difference))
        self._last = stamp
        return stamp + self.difference
