"""When something was measured, on our monotonic clock, by the stamps of somebody else's clock."""

from __future__ import annotations

JUMP = 1.0
"""A change [s] between the two clocks that counts as a jump of theirs. Ours."""
WINDOW = 2.0
"""How long [s] the quickest arrival counts, so that clocks may drift. Ours."""


class Offset:
    """The difference between their clock and ours, by the messages that took least time.

    A message that was held up on its way gets the time at which it was measured, so that old data is seen
    to be old; a jump of their clock has no effect.
    """

    def __init__(self) -> None:
        self.value: float | None = None
        """Ours minus theirs [s]; None before the first message."""
        self._next: float | None = None
        self._since = 0.0

    def map(self, theirs: float, arrived: float) -> float:
        """Their stamp [s] as a time on our clock, not after `arrived` [s]."""
        delay = arrived - theirs
        if self.value is None or delay < self.value or delay - self.value > JUMP:
            self.value, self._next, self._since = delay, None, arrived
        self._next = delay if self._next is None else min(self._next, delay)
        if arrived - self._since > WINDOW:
            self.value, self._next, self._since = self._next, None, arrived
        return min(arrived, theirs + self.value)
