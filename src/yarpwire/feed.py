"""The latest messages from one port of the robot, with reconnection after a restart."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from yarpwire.dialect import Dialect
from yarpwire.errors import PortError, RepetitionError, WireError
from yarpwire.incoming import Delivery
from yarpwire.network import Network

KEPT = 32
"""Number of the latest messages that are kept, to choose messages of several ports that were measured at
nearly the same time. Assumed: boards send up to 100 messages per second, and one may be 0.1 s behind another
before its data counts as too old."""
RESTARTED = 100
"""If the number in a message is smaller than the previous number by more than this value, the sender counts
as restarted. Assumed: a message in the wrong order is never so late."""
LATE = 0.003
"""If a message does not arrive at the expected time, the feed waits for at most this time [s] longer.
Assumed: a fraction of a control period."""
MIXED = 0.1
"""Weight of a new interval in the running mean of the intervals between messages. Assumed: with this weight,
the mean depends mainly on the latest ten messages."""
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True, eq=False)
class Sample(Generic[Value]):
    """One message of a port."""

    value: Value
    stamp: float
    """Time of measurement [s] on this machine's monotonic clock."""
    sequence: int
    """Number of the message, which increases by one with each message."""


class SenderClock(Protocol):
    """Converts times on a sender's clock to times on this machine's monotonic clock."""

    difference: float | None
    """Time on this machine's clock minus time on the sender's clock [s]. The value is None before the first
    message."""

    def place(self, stamp: float, arrival: float) -> float | None:
        """Returns the time of measurement [s] of a message, on this machine's clock.

        `stamp` [s] is the time in the message, on the sender's clock. `arrival` [s] is the time of arrival,
        on this machine's clock. Returns None if an earlier message has an equal or a later stamp.
        """


class Feed(Generic[Value]):
    """Reads one port and keeps the latest messages. Unreadable messages are counted and dropped. Messages
    that repeat earlier values (`decode` raises RepetitionError) are dropped and not counted."""

    def __init__(
        self,
        source: str,
        network: Network,
        dialect: Dialect,
        decode: Callable[[Delivery], Value],
        *,
        own: str,
        carrier: str,
        clock: SenderClock | None = None,
    ) -> None:
        """Connects to the port `source`.

        `clock` gives the time of measurement of a message. Without `clock`, the time of arrival is used.
        Raises UnknownNameError if the port is not registered, and PortError if the connection fails.
        """
        self.source = source
        self.recent: tuple[Sample[Value], ...] = ()
        """The latest messages, at most `KEPT`, oldest first."""
        self.clock = clock
        """Conversion from the sender's clock to this machine's clock; None if no `clock` was given."""
        self.lost = 0
        """Number of lost messages, computed from gaps in the message counts."""
        self.wrong = 0
        """Number of messages that were dropped because they are invalid."""
        self.last_error = ""
        """Error of the last invalid message."""
        self._decode, self._carrier = decode, carrier
        self._count: int | None = None
        self._arrived = self._heard = 0.0
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
        """Returns the kept message whose time of measurement is nearest to `stamp` [s]; None if no message
        has arrived."""
        return min(self.recent, key=lambda sample: abs(sample.stamp - stamp), default=None)

    def wait(self, seconds: float) -> bool:
        """Waits at most `seconds` [s] for the first message. Returns True if a message has arrived."""
        return self._came.wait(seconds)

    def await_due(self, until: float, longer: float) -> None:
        """Waits for the next message if it is due before `until` [s]. Without this wait, a program that
        reads shortly before a message arrives would get this message one period later. Does not wait if the
        interval between messages is at most `longer` [s]."""
        before, due, now = self.recent, self._arrived + self._every, time.monotonic()
        if self._every <= longer or not now - LATE <= due <= until:
            return
        self._fresh.clear()
        if self.recent is before:
            self._fresh.wait(due + LATE - now)

    def silent(self, now: float) -> float:
        """Returns the time [s] since the last message."""
        return now - self._heard

    def reconnect(self) -> None:
        """Connects to the source again. Raises PortError if that fails."""
        self.port.listen_to(self.source, self._carrier)

    def close(self) -> None:
        """Closes the port."""
        self.port.close()

    def _receive(self, delivery: Delivery) -> None:
        try:
            if delivery.sender != self.source:
                raise WireError(
                    f"{delivery.sender[:60]} sends to {self.port.name}; valid: {self.source} alone"
                )
            value = self._decode(delivery)
        except RepetitionError:
            self._heard = delivery.arrived
            if delivery.stamp is not None:
                self._is_old(delivery.stamp.count)
            return
        except WireError as error:
            self.wrong += 1
            self.last_error = str(error)
            return
        stamp = delivery.stamp
        self._arrived = self._heard = delivery.arrived
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
        """Returns the time of measurement [s] of a new message, on this machine's clock. `stamp` [s] is the
        time by the sender's clock, and `arrived` [s] the time of arrival."""
        if self.clock is None:
            return arrived
        placed = self.clock.place(stamp, arrived)
        if placed is None and self.clock.difference is not None:
            # Some time stamps are too coarse to distinguish messages that arrive together.
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
