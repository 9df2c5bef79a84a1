"""One commander per driver within a program; the lease keeps other programs away."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from tci.errors import DriverError

Given = TypeVar("Given")


class Baton:
    """Shows who commands a robot in this program. Drivers around one another share it."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._lock = threading.Lock()
        self._holder = ""
        self._writer: int | None = None

    @contextmanager
    def taken(self, who: str) -> Iterator[None]:
        """Raises DriverError if somebody has it already."""
        with self._lock:
            if self._holder:
                raise self._refusal()
            self._holder = f"{who} (thread {threading.current_thread().name})"
        try:
            yield
        finally:
            self._holder = ""

    def passed(self, write: Callable[[Given], Given], safe: Given) -> Given:
        """Lets the holder write once."""
        self._writer = threading.get_ident()
        try:
            return write(safe)
        finally:
            self._writer = None

    def check(self) -> None:
        """Raises DriverError if this is a write beside the holder's."""
        if self._holder and self._writer != threading.get_ident():
            raise self._refusal()

    def _refusal(self) -> DriverError:
        return DriverError(
            f"{self._robot} is commanded by {self._holder} already; valid: one commander at a time, "
            "so end that first"
        )
