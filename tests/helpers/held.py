"""Threads and file descriptors of this process, for tests which check that a driver releases all of them."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from tci.drivers.driver import Driver


def held() -> set[object]:
    """Returns the threads and file descriptors of this process. A socket or pipe counts once, even if it has
    several descriptors, because a library that checks a socket opens a second descriptor for a moment."""
    found: set[object] = {*threading.enumerate()}
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed in the meantime
            name = os.readlink(f"/proc/self/fd/{number}")
            found.add(name if name.startswith(("socket:", "pipe:")) else (number, name))
    return found


def left_behind(
    make: Callable[[], Driver], use: Callable[[Driver], object], *, patience: float = 30.0
) -> set[object]:
    """Returns the threads and descriptors that were opened since a driver was opened, and that still exist
    `patience` [s] after the driver was closed."""
    before = held()
    driver = make()
    use(driver)
    opened = held() - before
    driver.close()
    end = time.monotonic() + patience
    while (left := opened & held()) and time.monotonic() < end:
        gc.collect()  # each topic of rospy has an epoll descriptor, which is part of a reference cycle
        time.sleep(0.05)
    return left
