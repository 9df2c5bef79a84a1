"""When something was measured, on our monotonic clock, by the stamps of somebody else's clock."""

from __future__ import annotations

import math

JUMP = 1.0
"""A change [s] between the two clocks that counts as a jump of theirs. Ours."""
WINDOW = 2.0
"""How long [s] the quickest arrival counts, so that clocks may drift. Ours."""
FIRST = 20
"""Messages after which the difference changes slowly only. Ours."""
SLEW = 0.1
"""By so much of the time between two messages the difference may change: speeds stay true to this. Ours."""


class Offset:
    """The difference between their clock and ours, by the messages that took least time.

    A message that was held up on its way gets the time at which it was measured, so that old data is seen
    to be old, and times between messages are those of the sender; a jump of their clock has no effect.
    """

    def __init__(self) -> None:
        self.value: float | None = None
        """Ours minus theirs [s]; None before the first message."""
        self._target = self._next = self._last = 0.0
        self._since = -math.inf
        self._count = 0

    def map(self, theirs: float, arrived: float) -> float:
        """Their stamp [s] as a time on our clock; the message came in at `arrived` [s]."""
        delay = arrived - theirs
        if self.value is None or abs(delay - self._target) > JUMP:
            self.value = self._target = self._next = delay
            self._since, self._count = arrived, 0
        self._target, self._next = min(self._target, delay), min(self._next, delay)
        if arrived - self._since > WINDOW:
            self._target, self._next, self._since = self._next, delay, arrived
        self._count += 1
        step = SLEW * max(0.0, theirs - self._last) if self._count > FIRST else math.inf
        self.value += max(-step, min(step, self._target - self.value))
        self._last = theirs
        return theirs + self.value
