"""Fault injectors for this process: the clock, the loop, the threads, and signals."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

from tci.lab.faults.injectors.injector import Injector

HOUR = 3600.0
THREAD = "rehearsal"
"""Name of the thread in which the injected error occurs."""


class ClockJump(Injector):
    """A jump of the system time by one hour, only in this process."""

    number = 13
    description = "the date of this process jumps by an hour; the monotonic clock does not"

    def begin(self) -> None:
        self._time: Callable[[], float] = time.time
        time.time = lambda: self._time() + HOUR

    def end(self) -> None:
        time.time = self._time


class Overrun(Injector):
    """One control period that lasts as long as five periods."""

    number = 41
    description = "one period takes as long as five"

    def begin(self) -> None:
        self.driver.clock.sleep_until(self.driver.clock.now() + 5.0 * self.driver.period)


class Terminated(Injector):
    """A signal of the operating system that asks the process to end."""

    number = 42
    description = "the process gets SIGTERM"

    def begin(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)


class ThreadFails(Injector):
    """An exception that ends a thread of this process."""

    number = 45
    description = "a thread beside the loop raises an exception"

    def begin(self) -> None:
        def fail() -> None:
            raise RuntimeError("a thread failed on purpose")

        thread = threading.Thread(target=fail, name=THREAD)
        thread.start()
        thread.join()
