"""A bound on the number of connections of a server, over any transport; a new connection is always accepted.

There is no login, so each connection is a stranger until it has sent a valid message. Strangers must do so
soon. If there are too many connections, strangers are closed first, then the one that was silent the longest:
a genuine client that has sent a valid message may be idle for any time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

MOST = 64
"""Largest number of connections of a server. Assumed: more than the ports of an iCub need of each other."""
PATIENCE = 2.0
"""Time [s] that a stranger has. Assumed: a client greets at once; a slow network takes a tenth of it."""


@dataclass(slots=True, eq=False)
class Visitor:
    """One connection."""

    end: Callable[[], None]
    """Function that closes it; called from whichever thread makes room."""
    last_message: float
    """Time [s] of its last message on the monotonic clock; at first, of its arrival."""
    verified: bool = False
    """True if it has sent a valid message."""
    host: str = ""
    """Address of its other end."""

    def mark_verified(self, now: float | None = None) -> None:
        """Records a valid message."""
        self.verified, self.last_message = True, time.monotonic() if now is None else now


def surplus(visitors: Iterable[Visitor], now: float, most: int) -> list[Visitor]:
    """Returns the connections to close so that at most `most` remain, in that order."""
    there = sorted(visitors, key=lambda one: (one.verified, one.last_message))
    late = sum(not one.verified and now - one.last_message > PATIENCE for one in there)
    return there[: max(late, len(there) - most)]


class Visitors:
    """The connections of one server. Methods may be called from any thread."""

    def __init__(self, most: int = MOST, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock = most, clock
        self._lock = threading.Lock()
        self._there: set[Visitor] = set()
        self.ended = 0
        """Number of connections that were closed to make room."""

    def __len__(self) -> int:
        return len(self._there)

    def welcome(self, end: Callable[[], None], host: str = "") -> Visitor:
        """Adds a connection; others are closed if it is one too many."""
        self.look(leave=1)
        visitor = Visitor(end, self._clock(), host=host)
        with self._lock:
            self._there.add(visitor)
        return visitor

    def look(self, *, leave: int = 0) -> None:
        """Closes surplus connections, so that `leave` places are free."""
        with self._lock:
            going = surplus(self._there, self._clock(), self._most - leave)
            self._there.difference_update(going)
            self.ended += len(going)
        for visitor in going:
            visitor.end()

    def leave(self, visitor: Visitor) -> None:
        """Removes a connection that has ended. A second call does nothing."""
        with self._lock:
            self._there.discard(visitor)

    def end_all(self) -> None:
        """Closes all connections, when the server closes."""
        with self._lock:
            going, self._there = self._there, set()
        for visitor in going:
            visitor.end()
