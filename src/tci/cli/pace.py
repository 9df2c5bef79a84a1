"""Tells when a simulation that others use is slower than real time."""

from __future__ import annotations

from collections.abc import Iterator

from tci.drivers.simulated import PacedWorldClock
from tci.messages.clock import Clock

EVERY = 5.0
"""Real time [s] between two lines."""
WORTH = 0.95
"""Share of real time below which a line is printed. Assumed: nobody sees less."""


class Pace:
    """Speed of a clock in real time. All other clocks than a paced simulation's count as in time."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock if isinstance(clock, PacedWorldClock) else None
        self._begin = self._told = clock.now()
        self._late = self._first = self.late

    @property
    def late(self) -> float:
        """Real time [s] that the simulation has lost so far."""
        return 0.0 if self._clock is None else self._clock.late

    def speed(self) -> float:
        """Share of real time at which the simulation ran since the start, at most 1."""
        return (
            1.0 if self._clock is None else _share(self._clock.now() - self._begin, self.late - self._first)
        )

    def listen(self, now: float) -> Iterator[str]:
        """Yields a line if the simulation was late within the last seconds before `now` [s]."""
        ran, lost = now - self._told, self.late - self._late
        if ran + lost < EVERY:
            return
        self._told, self._late = now, self.late
        if (share := _share(ran, lost)) < WORTH:
            yield (
                f"the simulation is late: within {ran + lost:.0f} s it did {ran:.1f} s ({share:.2f} of real "
                "time), so whoever uses it sees it slowed down; this machine is too busy"
            )


def _share(ran: float, lost: float) -> float:
    return ran / (ran + lost) if ran + lost > 0.0 else 1.0
