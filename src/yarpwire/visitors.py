"""So many connections of a server and no more, whatever carries them; there is always room for a newcomer.

Nobody logs in, so who connects is a stranger until it has said something that makes sense. Strangers have to
do that soon. Where there are too many, strangers go first, then who was silent the longest: a genuine client
that has said what it wants may then be idle for as long as it likes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

MOST = 64
"""Connections that a server holds at a time. Assumed: more than the ports of an iCub need of each other."""
PATIENCE = 2.0
"""Time [s] that a stranger has. Assumed: a client greets at once; a slow network takes a tenth of it."""


@dataclass(slots=True, eq=False)
class Visitor:
    """One connection."""

    end: Callable[[], None]
    """Ends it; called from whichever thread makes room."""
    heard: float
    """When it was last heard of [s], on the monotonic clock; at first when it came."""
    known: bool = False
    """Whether it has said something that makes sense."""
    host: str = ""
    """Address that it comes from."""

    def hear(self, now: float | None = None) -> None:
        """It has said something that makes sense."""
        self.known, self.heard = True, time.monotonic() if now is None else now


def surplus(visitors: Iterable[Visitor], now: float, most: int) -> list[Visitor]:
    """Those that have to go so that at most `most` stay: first in line first."""
    there = sorted(visitors, key=lambda one: (one.known, one.heard))
    late = sum(not one.known and now - one.heard > PATIENCE for one in there)
    return there[: max(late, len(there) - most)]


class Visitors:
    """The connections of one server. Any thread may call."""

    def __init__(self, most: int = MOST, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock = most, clock
        self._lock = threading.Lock()
        self._there: set[Visitor] = set()
        self.ended = 0
        """Connections that had to go."""

    def __len__(self) -> int:
        return len(self._there)

    def welcome(self, end: Callable[[], None], host: str = "") -> Visitor:
        """A newcomer; others go for it where it is one too many."""
        self.look(leave=1)
        visitor = Visitor(end, self._clock(), host=host)
        with self._lock:
            self._there.add(visitor)
        return visitor

    def look(self, *, leave: int = 0) -> None:
        """Let those go that have to, so that `leave` places are free."""
        with self._lock:
            going = surplus(self._there, self._clock(), self._most - leave)
            self._there.difference_update(going)
            self.ended += len(going)
        for visitor in going:
            visitor.end()

    def leave(self, visitor: Visitor) -> None:
        """It is gone by itself. A second call does nothing."""
        with self._lock:
            self._there.discard(visitor)

    def end_all(self) -> None:
        """The server closes."""
        with self._lock:
            going, self._there = self._there, set()
        for visitor in going:
            visitor.end()
