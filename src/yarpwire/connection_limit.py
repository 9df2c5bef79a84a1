"""A bound on the number of connections of a server, over any transport; a new connection is always accepted.

There is no login, so a connection is unknown until it has sent a valid message, which must happen soon. If
there are too many connections, unknown ones are closed first, then the one that was silent for the longest
time. Otherwise a client that has sent a valid message may be idle for any time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

MOST = 64
"""Largest number of connections of a server. Assumed: more than the ports of an iCub need of each other."""
PATIENCE = 2.0
"""Time [s] within which an unknown connection must send a valid message. Assumed: a client sends its greeting
immediately, and a slow network needs a tenth of this time."""


@dataclass(slots=True, eq=False)
class AcceptedConnection:
    """One connection."""

    end: Callable[[], None]
    """Function that closes it. Any thread may call it."""
    last_message: float
    """Time [s] of its last message on the monotonic clock; at first, of its arrival."""
    verified: bool = False
    """True if it has sent a valid message."""
    host: str = ""
    """Address of its other end."""

    def mark_verified(self, now: float | None = None) -> None:
        """Records a valid message."""
        self.verified, self.last_message = True, time.monotonic() if now is None else now


def surplus(connections: Iterable[AcceptedConnection], now: float, most: int) -> list[AcceptedConnection]:
    """Returns the connections to close so that at most `most` remain, in that order."""
    oldest_first = sorted(connections, key=lambda one: (one.verified, one.last_message))
    late = sum(not one.verified and now - one.last_message > PATIENCE for one in oldest_first)
    return oldest_first[: max(late, len(oldest_first) - most)]


class ConnectionLimit:
    """The connections of one server. Methods may be called from any thread."""

    def __init__(self, most: int = MOST, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock = most, clock
        self._lock = threading.Lock()
        self._open: set[AcceptedConnection] = set()
        self.ended = 0
        """Number of connections that were closed to make room."""

    def __len__(self) -> int:
        return len(self._open)

    def add(self, end: Callable[[], None], host: str = "") -> AcceptedConnection:
        """Adds a connection; others are closed if it is one too many."""
        self.trim(room=1)
        connection = AcceptedConnection(end, self._clock(), host=host)
        with self._lock:
            self._open.add(connection)
        return connection

    def trim(self, *, room: int = 0) -> None:
        """Closes surplus connections, so that `room` places are free."""
        with self._lock:
            going = surplus(self._open, self._clock(), self._most - room)
            self._open.difference_update(going)
            self.ended += len(going)
        for connection in going:
            connection.end()

    def remove(self, connection: AcceptedConnection) -> None:
        """Removes a connection that has ended. A second call does nothing."""
        with self._lock:
            self._open.discard(connection)

    def end_all(self) -> None:
        """Closes all connections, when the server closes."""
        with self._lock:
            going, self._open = self._open, set()
        for connection in going:
            connection.end()
