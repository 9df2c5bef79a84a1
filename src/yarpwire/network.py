"""The interface to a YARP network: ports by name, and connections between them.

It has two implementations, `wire` (pure Python) and `bindings` (YARP's). All other code, such as that of
boards and skin, is independent of both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from yarpwire.dialect import Dialect
from yarpwire.incoming import Answer, Delivery
from yarpwire.message import Stamp
from yarpwire.names import PATIENCE, Contact
from yarpwire.values import Array


class NamedPort(Protocol):
    """A port that others find by its name."""

    name: str
    last_error: str
    """Error of the last message that could not be decoded."""

    @property
    def outputs(self) -> Sequence[str]:
        """Names of the ports that this one sends to."""

    def write(self, value: Array | Sequence[Any], stamp: Stamp | None = None) -> None:
        """Sends a Vector (an array) or a Bottle (a list) to all readers. It never waits, and nothing is
        queued."""

    def listen_to(self, source: str, carrier: str) -> None:
        """Makes another port send to this one. Raises PortError, also when it refuses."""

    def register(self) -> None:
        """Registers the port, again after a restart of the name server. Raises PortError."""

    def close(self) -> None:
        """Unregisters the port and closes every connection."""


class Writer(Protocol):
    """A connection that sends to another port. It never waits."""

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        """Sends a Vector (an array) or a Bottle (a list), or drops it. Raises PortError for a lost reader."""

    def is_over(self) -> bool:
        """Returns True if the reader has disconnected."""

    def close(self) -> None:
        """Closes the connection."""


class Caller(Protocol):
    """Calls to another port, and their replies. Every failure is a PortError; calls are not repeated."""

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        """Returns the reply to a call; empty if the other end sends none."""

    def send_call(self, *items: Any) -> None:
        """Sends a call without waiting for its reply, which `read_reply` returns."""

    def is_answered(self, patience: float) -> bool:
        """Returns True if the reply to the oldest open call arrives within `patience` [s]."""

    def read_reply(self) -> list[Any]:
        """Returns the reply to the oldest open call."""

    def close(self) -> None:
        """Closes the connection."""


class Network(ABC):
    """A YARP network. Methods raise PortError when the name server does not answer."""

    title: str
    """Name of the implementation, for messages."""
    address: tuple[str, int]
    """Host and port of the name server."""
    dialect: Dialect | None = None
    """The only dialect that it supports; None for both."""

    @abstractmethod
    def list(self) -> list[Contact]:
        """Returns the contacts of all ports."""

    def lives(self, name: str) -> bool:
        """Returns True if a port is registered and answers."""
        return any(contact.name == name and contact.answers() for contact in self.list())

    @abstractmethod
    def query(self, name: str) -> Contact:
        """Returns the contact of a port. Raises UnknownNameError for one that is not registered."""

    @abstractmethod
    def port(
        self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> NamedPort:
        """Opens a port; `receive` gets each message, from a thread of the port's own, and answers calls."""

    @abstractmethod
    def writer(self, target: str, sender: str) -> Writer:
        """Connects to a port by fast_tcp. Raises PortError."""

    @abstractmethod
    def caller(self, target: Contact, sender: str, dialect: Dialect) -> Caller:
        """Returns the calls to a port, by tcp. The connection is opened when it is needed, and again after a
        failure."""
