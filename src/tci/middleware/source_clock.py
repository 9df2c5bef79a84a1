"""The clock of a sender, seen from here, without trusting that the two agree."""

from __future__ import annotations

import math

JUMP = 1.0
"""A stamp that is older than the last one by more than this [s] means a clock set back, or a sender that
started anew; less means a message out of order. Ours."""
WINDOW = 5.0
"""A delay that lasts for two windows [s] counts as the way's own. Ours."""


class SourceClock:
    """Turns a sender's stamps into times of our own clock, and knows what is old.

    The shortest way that a message took lately counts as no time at all; what took longer is older by the
    difference. So data that was held up on the way is not taken for fresh, and no clocks are compared.
    """

    def __init__(self) -> None:
        self._last = -math.inf
        self._least = self._before = math.inf
        self._since = -math.inf

    def place(self, stamp: float, arrival: float) -> float | None:
        """When something was measured [s, ours], stamped `stamp` [s, theirs] and here at `arrival` [s, ours].

        None for what is older than something before it, or the same again. A stamp of 0 says nothing: then
        it is the arrival that counts.
        """
        if not 0.0 < stamp < 1e12:  # also refuses NaN
            return arrival
        if stamp <= self._last:
            if self._last - stamp <= JUMP:
                return None
            self._least = self._before = math.inf
        if arrival - self._since > WINDOW:
            late = arrival - self._since > 2.0 * WINDOW
            self._before, self._least = math.inf if late else self._least, math.inf
            self._since = arrival
        self._last = stamp
        self._least = min(self._least, arrival - stamp)
        return stamp + min(self._least, self._before)
