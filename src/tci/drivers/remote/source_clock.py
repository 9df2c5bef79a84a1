"""Conversion of a sender's stamps to this process's clock, without synchronised clocks."""

from __future__ import annotations

import math

JUMP = 1.0
"""Jump [s] back of the stamps, or of the delay below its minimum, that means that the sender's clock was set
or the sender was restarted. A smaller jump is caused by a message out of order, or by a faster path. Assumed:
far above the delays of a local network."""
WINDOW = 5.0
"""Time [s] for which a minimum of the delay is used. A delay that lasts for two windows counts as a property
of the path. Assumed: clocks drift by less than a millisecond in this time."""
FIRST = 20
"""Number of messages after which the offset may change only slowly. Assumed: the shortest delay occurs among
them."""
SLEW = 0.1
"""Largest change of the offset, as a fraction of the time between two messages. Assumed: measured speeds are
then wrong by at most a tenth."""


class SourceClock:
    """Converts a sender's stamps to this process's clock, and detects delayed messages.

    The shortest recent delay of a message counts as zero; a longer one makes the message older by the
    difference. Thus delayed data does not look recent, times between messages are those of the sender, and a
    jump of the sender's clock has no effect.
    """

    def __init__(self) -> None:
        self.difference: float | None = None
        """Offset [s] of this clock from the sender's; None before the first message."""
        self._last = -math.inf
        self._least = self._next = math.inf
        self._since = -math.inf
        self._count = 0

    def place(self, stamp: float, arrival: float) -> float | None:
        """Returns the time of measurement [s, this clock] for a `stamp` [s, sender's clock] and `arrival` [s,
        this clock].

        None for a message that is older than an earlier one, or a repetition. A stamp of 0 means that there
        is no stamp; the result is then the time of arrival.
        """
        if not 0.0 < stamp < 1e12:  # NaN fails this test too
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
