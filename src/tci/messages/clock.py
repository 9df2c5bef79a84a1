"""Clocks. Functions that need the time take a clock as an argument, so tests and simulations need not
wait."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Iterator
from typing import Protocol

ROUNDING = 1e-6
"""Tolerance, as a fraction of a period. A time that comes before the next period by at most this fraction
counts as part of the next period. Without this tolerance, rounding (1e-11 s on a clock that has run for days)
could make a period occur twice."""
TAIL = 150e-6
"""Length [s] of the last part of a sleep, in which the thread waits busily to wake up on time. Assumed:
longer than the usual delay of a wake-up (about 120 us)."""


class Clock(Protocol):
    """A monotonic clock [s] with an arbitrary zero."""

    def now(self) -> float:
        """Returns the current time [s]."""
        ...

    def sleep_until(self, stamp: float) -> None:
        """Waits until `now()` is at least `stamp` [s]. Returns immediately if this time has already
        passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, which does not follow changes of the date.

    This clock sleeps with the finest timer slack and busy-waits for the last `tail` [s]. The median delay of
    a wake-up is then below 1 us instead of about 120 us; the busy wait needs processor time. Other threads
    can run until the busy wait begins.
    """

    def __init__(self, *, tail: float = TAIL) -> None:
        self.tail = tail
        """Length [s] of the busy wait at the end of a sleep."""
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
    """Makes waits of this thread end more punctually on Linux, where they may otherwise be 50 us late. Does
    nothing on other systems."""
    if sys.platform != "linux":
        return
    import ctypes

    set_timer_slack = 29  # prctl's PR_SET_TIMERSLACK, in ns
    ctypes.CDLL(None).prctl(set_timer_slack, 1, 0, 0, 0)


class SteppedClock:
    """A clock that stands still until somebody waits for a later time: of a simulation, a recording or
    a test."""


class ManualClock(SteppedClock):
    """A clock for tests and simulations. Its time advances only when a caller calls `advance` or
    `sleep_until`."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def sleep_until(self, stamp: float) -> None:
        self._now = max(self._now, stamp)

    def advance(self, seconds: float) -> None:
        """Advances the time by `seconds` [s]."""
        self._now += seconds


def ticks(
    clock: Clock, period: float, *, duration: float | None = None, start: float | None = None
) -> Iterator[float]:
    """Yields the current time [s] once per `period` [s]. The first period begins at the time `start` [s], by
    default now.

    Ends after `duration` [s], if given. Ticks that were missed are skipped.
    """
    start = clock.now() if start is None else start
    count = 0
    while duration is None or count * period < duration - 1e-9:
        clock.sleep_until(start + count * period)
        now = clock.now()
        yield now
        # A tick that is late by a whole period counts as the next tick, so that one period never has two
        # ticks.
        served = int((now - start) / period + ROUNDING)
        count = max(served + 1, int((clock.now() - start) / period + ROUNDING))


class Every:
    """Limits an action to once per period [s] on any clock. Missed periods are skipped."""

    def __init__(self, period: float) -> None:
        self._period, self._next = period, -math.inf

    def due(self, now: float) -> bool:
        """Returns True if the action is due at the time `now` [s], and then counts the action as done."""
        if now < self._next:
            return False
        self._next = max(self._next + self._period, now + 0.5 * self._period)
        return True
