"""Counting what a process holds, for tests of what is left when something has ended."""

from __future__ import annotations

import os
import threading
from contextlib import suppress


def held() -> set[object]:
    """Threads and descriptors of this process. A socket or pipe is one thing, whatever handles it has: those
    who look after a library's sockets have a second one for a moment."""
    found: set[object] = {*threading.enumerate()}
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed meanwhile
            name = os.readlink(f"/proc/self/fd/{number}")
            found.add(name if name.startswith(("socket:", "pipe:")) else (number, name))
    return found
