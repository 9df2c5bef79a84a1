"""Clocks. Time is injected everywhere, so that tests and simulation never wait."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Iterator
from typing import Protocol

ROUNDING = 1e-6
"""Share of a period by which a time counts as the next one: the time of a clock that has run for days is
rounded to 1e-11 s, and no period must be served twice."""
TAIL = 150e-6
"""Time [s] before a wake-up in which a thread keeps its turn, as another might keep it too long. Ours."""


class Clock(Protocol):
    """A monotonic clock [s]. Its zero has no meaning."""

    def now(self) -> float:
        """Time now [s]."""
        ...

    def sleep_until(self, stamp: float) -> None:
        """Return when `now()` is at least `stamp` [s]; at once when it already is."""
        ...


class MonotonicClock:
    """The machine's monotonic clock: it does not follow changes of the date.

    It sleeps with the finest timer slack, and the last `tail` [s] it is busy: the median wake-up is then
    below 1 us late instead of about 120, at the price of that share of a core. Other threads of the program
    get their turn until 150 us before.
    """

    def __init__(self, *, tail: float = TAIL) -> None:
        self.tail = tail
        """How long [s] it is busy before it returns."""
        self._fine: set[int] = set()

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, stamp: float) -> None:
        thread = threading.get_ident()
        if thread not in self._fine:
            self._fine.add(thread)
            _least_slack()
        while (left := stamp - time.monotonic()) > 0.0:
            if left > self.tail:
                time.sleep(left - self.tail)
            elif left > TAIL:
                time.sleep(0.0)


def _least_slack() -> None:
    """Ask Linux to wake this thread without the usual slack of 50 us; elsewhere nothing."""
    if sys.platform != "linux":
        return
    import ctypes

    set_timer_slack = 29  # prctl's PR_SET_TIMERSLACK, in ns
    ctypes.CDLL(None).prctl(set_timer_slack, 1, 0, 0, 0)


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


def ticks(
    clock: Clock, period: float, *, duration: float | None = None, start: float | None = None
) -> Iterator[float]:
    """Yield the time now [s] every `period` [s], from `start` [s] or now on, for `duration` [s] or for ever.

    A tick that comes too late is skipped, never caught up in a burst.
    """
    start = clock.now() if start is None else start
    count = 0
    while duration is None or count * period < duration - 1e-9:
        clock.sleep_until(start + count * period)
        now = clock.now()
        yield now
        # A tick that came a whole period late was that of the later one: two in one period would be a burst.
        served = int((now - start) / period + ROUNDING)
        count = max(served + 1, int((clock.now() - start) / period + ROUNDING))


class Every:
    """What is done at most once in a period [s], by any clock: after a pause it is not caught up."""

    def __init__(self, period: float) -> None:
        self._period, self._next = period, -math.inf

    def due(self, now: float) -> bool:
        """Whether it is to be done now [s]; then it is taken for done."""
        if now < self._next:
            return False
        self._next = max(self._next + self._period, now + 0.5 * self._period)
        return True
