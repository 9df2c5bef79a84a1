"""Conversion of a sender's time stamps to this process's clock, without synchronised clocks."""

from __future__ import annotations

import math

JUMP = 1.0
"""Threshold [s] for detecting a jump of the sender's clock. The clock has jumped if a stamp is earlier than
the previous stamp by more than this, or if a delay is shorter than the shortest earlier delay by more than
this. A clock jumps if a person sets the clock or restarts the sender. Smaller differences have other causes:
messages out of order, or a changing delay of the network. Assumed: the delays of a local network are far
shorter."""
WINDOW = 5.0
"""Length [s] of the time windows in which the shortest delay of a message is determined. The minimum of two
successive windows is used, so a shortest delay that does not occur again is forgotten. Assumed: clocks drift
by less than a millisecond in this time."""
FIRST = 20
"""Number of messages after which the offset between the sender's clock and this process's clock may change
only slowly. Assumed: the shortest delay occurs in these first messages."""
SLEW = 0.1
"""Largest change of the offset between the two clocks, as a fraction of the time between two messages.
Assumed: this makes measured speeds wrong by at most a tenth."""


class SourceClock:
    """Converts a sender's stamps to this process's clock, and detects delayed messages.

    The shortest recent delay of a message counts as zero. A message with a longer delay is already old when
    it arrives: its age is the difference of the two delays. Therefore delayed data does not look recent, and
    the times between messages are those on the sender's clock. After a jump of the sender's clock, the
    conversion starts anew.
    """

    def __init__(self) -> None:
        self.difference: float | None = None
        """Offset [s] of this process's clock from the sender's clock; None before the first message."""
        self._last = -math.inf
        self._least = self._next = math.inf
        self._since = -math.inf
        self._count = 0

    def place(self, stamp: float, arrival: float) -> float | None:
        """Returns the time [s] of measurement on this process's clock, or None for an outdated message.

        `stamp` [s] is on the sender's clock, `arrival` [s] on this process's clock. A message is outdated if
        the message's stamp is not above the stamp of an earlier message. A stamp of 0 means that the message
        has no stamp; the function then returns `arrival`.
        """
        if not 0.0 < stamp < 1e12:  # also true if `stamp` is NaN
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
