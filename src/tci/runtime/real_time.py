"""A loop that other programs on the machine do not interrupt, where the system lets it (Linux)."""

from __future__ import annotations

import os
import struct
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from tci.errors import TciError

PRIORITY = 50
"""As ros2_control: as high as what the kernel does for devices. 99 is for its own watchdogs."""
WAKE_UP = Path("/dev/cpu_dma_latency")
"""Whoever holds this file open and wrote a time into it never waits longer for a processor to wake up (the
kernel's "PM Quality of Service", as cyclictest uses it)."""


@contextmanager
def real_time(
    *, priority: int = PRIORITY, processor: int | None = None, awake: bool = False
) -> Iterator[None]:
    """Inside the block this thread goes before all that is not real time (SCHED_FIFO), on one `processor` if
    given.

    Threads and processes that are started inside inherit that. A capability that never ends takes its
    processor away from all others. With `awake` no processor of the machine sleeps meanwhile, which costs
    power: one that slept since the last period, above all a virtual one, finds its caches empty. Raises
    TciError, before anything is changed, where the system does not permit it.
    """
    if sys.platform != "linux":
        raise TciError(f"real time on {sys.platform}; valid: on Linux")
    least, most = (find(os.SCHED_FIFO) for find in (os.sched_get_priority_min, os.sched_get_priority_max))
    if not least <= priority <= most:
        raise TciError(f"priority {priority}; valid: {least} to {most}")
    processors = os.sched_getaffinity(0)
    if processor is not None and processor not in processors:
        valid = ", ".join(map(str, sorted(processors)))
        raise TciError(f"processor {processor}; valid here: {valid}")
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    with ExitStack() as stack:
        if awake:
            stack.enter_context(_awake())
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except PermissionError as error:
            raise TciError(
                f"the system permits no real time with priority {priority}; valid: as root, or after a line "
                f"'@realtime - rtprio {most}' in /etc/security/limits.conf for a group that you are in"
            ) from error
        stack.callback(os.sched_setscheduler, 0, policy, before)
        stack.callback(os.sched_setaffinity, 0, processors)
        if processor is not None:
            os.sched_setaffinity(0, {processor})
        yield


@contextmanager
def _awake() -> Iterator[None]:
    """Processors don't sleep inside the block. The kernel lets them again when this process ends, however."""
    try:
        file = WAKE_UP.open("wb", buffering=0)
    except OSError as error:
        raise TciError(
            f"processors can't be kept awake: {WAKE_UP}: {error.strerror}; valid: as root, after a udev rule "
            "that lets a group of yours write it, or without awake"
        ) from error
    with file:
        file.write(struct.pack("i", 0))
        yield


@contextmanager
def real_time_where_permitted() -> Iterator[None]:
    """The same where the system permits it; elsewhere nothing changes."""
    with ExitStack() as stack:
        with suppress(TciError):
            stack.enter_context(real_time())
        yield
