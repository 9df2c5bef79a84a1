"""Threads and descriptors of this process, for tests of what is left when a driver has ended."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from tci.drivers.driver import Driver


def held() -> set[object]:
    """Threads and descriptors of this process. A socket or pipe is one thing, whatever handles it has: those
    who look after a library's sockets have a second one for a moment."""
    found: set[object] = {*threading.enumerate()}
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed meanwhile
            name = os.readlink(f"/proc/self/fd/{number}")
            found.add(name if name.startswith(("socket:", "pipe:")) else (number, name))
    return found


def left_behind(
    make: Callable[[], Driver], use: Callable[[Driver], object], *, patience: float = 30.0
) -> set[object]:
    """Everything that came to this process with a driver and is still there `patience` [s] after its end."""
    before = held()
    driver = make()
    use(driver)
    opened = held() - before
    driver.close()
    end = time.monotonic() + patience
    while (left := opened & held()) and time.monotonic() < end:
        gc.collect()  # each topic of rospy has an epoll descriptor, in a circle of objects
        time.sleep(0.05)
    return left
