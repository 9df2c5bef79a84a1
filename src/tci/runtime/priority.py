"""Real-time priority for a control loop on Linux, if the system permits real-time priority."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from tci.errors import TciError

PRIORITY = 50
"""Real-time priority of the loop, equal to the priority of ros2_control and of the kernel's interrupt
threads. Priority 99 is not used, since the kernel's watchdogs have this priority."""


@contextmanager
def real_time(*, priority: int = PRIORITY, processor: int | None = None) -> Iterator[None]:
    """Gives the thread of the `with` block real-time priority (SCHED_FIFO).

    The system then runs this thread before all threads without real-time priority. If `processor` is given,
    the thread runs only on this processor. Threads and processes that are started inside the `with` block
    inherit the priority. A capability that does not return then blocks the thread's processor for all other
    programs. Linux stops such a thread for 50 ms in each second in which it was busy for more than 95 %
    (`/proc/sys/kernel/sched_rt_runtime_us`), so a loop must sleep in each period. Raises TciError if the
    system does not permit real-time priority. In this case the thread's priority does not change.
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
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError as error:
        raise TciError(
            f"the system permits no real time with priority {priority}; valid: as root, or after a line "
            f"'@realtime - rtprio {most}' in /etc/security/limits.conf for a group that you are in"
        ) from error
    try:
        if processor is not None:
            os.sched_setaffinity(0, {processor})
        yield
    finally:
        os.sched_setaffinity(0, processors)
        os.sched_setscheduler(0, policy, before)


@contextmanager
def real_time_where_permitted() -> Iterator[None]:
    """Runs the `with` block with real-time priority if the system permits real-time priority. Otherwise runs
    the block with unchanged priority.
    """
    with ExitStack() as stack:
        with suppress(TciError):
            stack.enter_context(real_time())
        yield
