"""A bound on the number of connections of a server. A new connection is always accepted; if there are too
many, older connections are closed.

There is no login. A connection counts as unknown until it has sent a valid message. An unknown connection
must send a valid message within 2 s (PATIENCE). If there are too many connections, unknown connections are
closed first, then the connections that were silent for the longest time. While there are not too many
connections, a connection that has sent a valid message may be idle for any time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

MOST = 64
"""Largest number of connections of a server. Assumed: a port of an iCub needs fewer connections."""
PATIENCE = 2.0
"""Time [s] within which an unknown connection must send a valid message. Assumed: a client sends its greeting
immediately, and a slow network needs a tenth of this time."""


@dataclass(slots=True, eq=False)
class AcceptedConnection:
    """One connection that the server accepted."""

    end: Callable[[], None]
    """Function that closes the connection. Any thread may call this function."""
    last_message: float
    """Time [s] of the connection's last message, on the monotonic clock. Before the first message, it is the
    time of the connection's arrival."""
    verified: bool = False
    """True if the connection has sent a valid message."""
    host: str = ""
    """Address of the connection's other end."""

    def mark_verified(self, now: float | None = None) -> None:
        """Records a valid message that arrived at `now` [s]; None is the present time."""
        self.verified, self.last_message = True, time.monotonic() if now is None else now


def surplus(connections: Iterable[AcceptedConnection], now: float, most: int) -> list[AcceptedConnection]:
    """Returns the connections to close, in the order of closing, so that at most `most` remain. Connections
    that have sent no valid message within PATIENCE are always closed."""
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
        """Adds a connection. If there are then more connections than the limit, closes other connections."""
        self.trim(room=1)
        connection = AcceptedConnection(end, self._clock(), host=host)
        with self._lock:
            self._open.add(connection)
        return connection

    def trim(self, *, room: int = 0) -> None:
        """Closes so many connections that `room` new connections can be added."""
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
        """Closes all connections. Called when the server closes."""
        with self._lock:
            going, self._open = self._open, set()
        for connection in going:
            connection.end()
