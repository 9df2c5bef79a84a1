"""What comes in from one port of the robot, and how it is got again after a restart."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from yarpwire.dialect import Dialect
from yarpwire.errors import PortError, WireError
from yarpwire.incoming import Delivery
from yarpwire.network import Network

KEPT = 4
"""Messages that are kept, so that those of several ports can be taken from about one time. Ours."""
RESTARTED = 100
"""By so many a count may fall back before its sender counts as started anew. Ours."""
LATE = 0.003
"""How much longer [s] than its time a message is waited for. Ours."""
MIXED = 0.1
"""Share of a new time between two messages in their mean. Ours."""
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True, eq=False)
class Sample(Generic[Value]):
    """One message of a port."""

    value: Value
    stamp: float
    """When it was measured [s], on our monotonic clock."""
    sequence: int
    """Counts up with each message that was new."""


class Clock(Protocol):
    """Maps the clock of a sender to this machine's monotonic clock."""

    difference: float | None
    """Ours minus theirs [s]; None before the first message."""

    def place(self, stamp: float, arrival: float) -> float | None:
        """Time [s, ours] of what was stamped `stamp` [s, theirs] and came at `arrival` [s, ours].

        None if it is older than something before it, or has its stamp.
        """


class Feed(Generic[Value]):
    """Reads one port. Only the latest messages are kept; what can't be read is counted and dropped."""

    def __init__(
        self,
        source: str,
        network: Network,
        dialect: Dialect,
        decode: Callable[[Delivery], Value],
        *,
        own: str,
        carrier: str,
        clock: Clock | None = None,
    ) -> None:
        """Connect. `clock` tells when a message was measured; without one, the time of its arrival counts.

        Raises PortError, as UnknownNameError for a port that is not there."""
        self.source = source
        self.recent: tuple[Sample[Value], ...] = ()
        """The latest few messages, oldest first."""
        self.clock = clock
        """Maps their clock to ours, if one was handed in."""
        self.lost = 0
        """Messages missing between those that came, by their count."""
        self.wrong = 0
        """Messages that were dropped because they can't be what they should."""
        self.last_error = ""
        """What was wrong with the last of them."""
        self._decode, self._carrier = decode, carrier
        self._count: int | None = None
        self._arrived = 0.0
        self._every = 0.0
        self._came, self._fresh = threading.Event(), threading.Event()
        network.query(source)
        self.port = network.port(own, dialect, self._receive)
        try:
            self.port.listen_to(source, carrier)
        except PortError:
            self.port.close()
            raise

    @property
    def latest(self) -> Sample[Value] | None:
        """The latest message."""
        return self.recent[-1] if self.recent else None

    def at(self, stamp: float) -> Sample[Value] | None:
        """The message that was measured nearest to a time [s]."""
        return min(self.recent, key=lambda sample: abs(sample.stamp - stamp), default=None)

    def wait(self, seconds: float) -> bool:
        """Whether something came, at the latest after so long."""
        return self._came.wait(seconds)

    def await_due(self, until: float, longer: float) -> None:
        """Wait for the next message if it is due before `until` [s]: who looks just before it comes sees it a
        period later. Those that come more often than every `longer` [s] are not waited for."""
        before, due, now = self.recent, self._arrived + self._every, time.monotonic()
        if self._every <= longer or not now - LATE <= due <= until:
            return
        self._fresh.clear()
        if self.recent is before:
            self._fresh.wait(due + LATE - now)

    def silent(self, now: float) -> float:
        """How long [s] nothing has come."""
        return now - self._arrived

    def reconnect(self) -> None:
        """Ask the source again. Raises PortError."""
        self.port.listen_to(self.source, self._carrier)

    def close(self) -> None:
        """Let go of the port."""
        self.port.close()

    def _receive(self, delivery: Delivery) -> None:
        try:
            if delivery.sender != self.source:
                raise WireError(
                    f"{delivery.sender[:60]} sends to {self.port.name}; valid: {self.source} alone"
                )
            value = self._decode(delivery)
        except WireError as error:
            self.wrong += 1
            self.last_error = str(error)
            return
        stamp = delivery.stamp
        self._arrived = delivery.arrived
        measured = delivery.arrived
        if stamp is not None:
            if self._is_old(stamp.count):
                return
            measured = self._measured(stamp.time, delivery.arrived)
        if self.recent:
            gap = measured - self.recent[-1].stamp
            self._every += (gap - self._every) * (MIXED if self._every else 1.0)
        sequence = self.recent[-1].sequence + 1 if self.recent else 0
        self.recent = (*self.recent[1 - KEPT :], Sample(value, measured, sequence))
        self._came.set()
        self._fresh.set()

    def _measured(self, stamp: float, arrived: float) -> float:
        """Time [s, ours] of a message that is new by its count."""
        if self.clock is None:
            return arrived
        placed = self.clock.place(stamp, arrived)
        if placed is None and self.clock.difference is not None:
            # Some stamps are too coarse for messages that come together.
            placed = stamp + self.clock.difference
        return arrived if placed is None else placed

    def _is_old(self, count: int) -> bool:
        before, self._count = self._count, count
        if before is None or count > before:
            self.lost += 0 if before is None else count - before - 1
            return False
        if before - count > RESTARTED or count == 0:
            return False
        self._count = before
        return True
