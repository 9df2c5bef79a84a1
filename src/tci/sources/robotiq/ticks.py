"""A device's counter as a time, where nobody says how long its ticks are."""

from __future__ import annotations

import math

LONG = 1.0
"""Time [s] of arrivals that a tick is measured over."""
NEAR = 0.02
"""Largest relative difference between a measured tick and a power of ten. Assumed: arrivals are a few
milliseconds uneven."""


class Ticks:
    """Takes a tick for the power of ten [s] that arrivals show, such as 1 us. A counter that shows none, or
    stands still, is no time."""

    def __init__(self) -> None:
        self.length: float | None = None
        """[s]; None until it is known."""
        self._first: tuple[int, float] | None = None

    def seconds(self, count: int, arrival: float) -> float | None:
        """The time of a count [s] on the device's own clock; None as long as its ticks are unknown."""
        if self.length is None:
            self._measure(count, arrival)
        return None if self.length is None else count * self.length

    def _measure(self, count: int, arrival: float) -> None:
        if self._first is None or count <= self._first[0]:
            self._first = count, arrival
        elif (span := arrival - self._first[1]) >= LONG:
            shown = span / (count - self._first[0])
            power = 10.0 ** round(math.log10(shown))
            if abs(shown / power - 1.0) < NEAR:
                self.length = power
            self._first = count, arrival
