"""Clocks. Time is injected everywhere, so that tests and simulation never wait."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock [s]. Its zero has no meaning."""

    def now(self) -> float:
        """Time now [s]."""
        ...

    def sleep_until(self, stamp: float) -> None:
        """Return when `now()` is at least `stamp` [s]; at once when it already is."""
        ...


class MonotonicClock:
    """The machine's monotonic clock: it does not follow changes of the date."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, stamp: float) -> None:
        while (left := stamp - time.monotonic()) > 0.0:
            time.sleep(left)


class ManualClock:
    """A clock that moves only when told to, or when somebody sleeps on it."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def sleep_until(self, stamp: float) -> None:
        self._now = max(self._now, stamp)

    def advance(self, seconds: float) -> None:
        """Move time forward by `seconds` [s]."""
        self._now += seconds


def ticks(clock: Clock, period: float, *, duration: float | None = None) -> Iterator[float]:
    """Yield the time now [s] every `period` [s], for `duration` [s] or for ever.

    A tick that comes too late is skipped, never caught up in a burst.
    """
    start = clock.now()
    count = 0
    while duration is None or count * period < duration - 1e-9:
        clock.sleep_until(start + count * period)
        now = clock.now()
        yield now
        count = max(count + 1, int((clock.now() - start) / period + 1e-9))
