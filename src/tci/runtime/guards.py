"""What surrounds a running loop: signals, threads that fail, and the garbage collector."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """What came from outside the loop and ends it."""

    def __init__(self) -> None:
        self.signal: int | None = None
        """Number of the signal, once one came."""
        self.failure: BaseException | None = None
        """What a thread raised, once one did."""
        self.thread = ""
        """Name of that thread."""

    def raise_it(self) -> None:
        """Raise what came: KeyboardInterrupt, SystemExit (128 + signal), or the thread's own exception."""
        if self.failure is not None:
            raise self.failure
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.signal is not None:
            raise SystemExit(128 + self.signal)


@contextmanager
def interruptions() -> Iterator[Interruption]:
    """Catch signals (in the main thread) and exceptions of any thread inside the block.

    The first signal is noted for the loop, which brings the robot to rest; a second one interrupts at
    once, for a capability that hangs.
    """
    found = Interruption()

    def on_signal(number: int, frame: FrameType | None) -> None:
        if found.signal is not None:
            raise KeyboardInterrupt
        found.signal = number

    _watch_threads(found)
    here = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, on_signal) for number in SIGNALS} if here else {}
    try:
        yield found
    finally:
        _leave_threads(found)
        for number, handler in before.items():
            signal.signal(number, handler)


_threads = threading.Lock()
_watching: list[Interruption] = []
"""Every block that is open: loops of several robots may run in threads of one process."""
_hook = threading.excepthook


def _in_thread(told: threading.ExceptHookArgs) -> None:
    if told.exc_value is not None and told.exc_type is not SystemExit:
        for found in _watching:
            if found.failure is None:
                found.failure = told.exc_value
                found.thread = told.thread.name if told.thread else "a thread"
    _hook(told)


def _watch_threads(found: Interruption) -> None:
    global _hook
    with _threads:
        if not _watching:
            _hook, threading.excepthook = threading.excepthook, _in_thread
        _watching.append(found)


def _leave_threads(found: Interruption) -> None:
    with _threads:
        _watching.remove(found)
        if not _watching:
            threading.excepthook = _hook


@contextmanager
def frozen_garbage() -> Iterator[None]:
    """Keep what is alive now out of the garbage collector, whose pauses grow with it."""
    if gc.get_freeze_count():
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
