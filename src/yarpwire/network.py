"""The interface to a YARP network: ports by name, and connections between them.

The interface has two implementations: `wire` in pure Python, and `bindings` with YARP's own bindings. All
other code, for example for boards and skin, works with both.
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
    """A port that other programs find by its name."""

    name: str
    last_error: str
    """Error of the last message that could not be decoded."""

    @property
    def outputs(self) -> Sequence[str]:
        """Names of the ports to which this port sends."""

    def write(self, value: Array | Sequence[Any], stamp: Stamp | None = None) -> None:
        """Sends a Vector (an array) or a Bottle (a list) to all readers. Never waits: if a reader is too
        slow, the message is dropped."""

    def listen_to(self, source: str, carrier: str) -> None:
        """Makes the port `source` send to this port. Raises PortError if `source` can't be reached or
        refuses."""

    def register(self) -> None:
        """Registers the port. Call this again after the name server has restarted. Raises PortError if the
        registration fails."""

    def close(self) -> None:
        """Unregisters the port and closes every connection."""


class Writer(Protocol):
    """A connection that sends to another port. Sending never waits."""

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        """Sends a Vector (an array) or a Bottle (a list). Returns False if the message was dropped, since the
        reader is too slow. Raises PortError if the reader is lost."""

    def is_over(self) -> bool:
        """Returns True if the reader has disconnected."""

    def close(self) -> None:
        """Closes the connection."""


class Caller(Protocol):
    """Makes calls to another port. Every failure raises PortError. A failed call is not repeated."""

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        """Makes a call and returns the reply, which is empty if the other end sends no reply."""

    def send_call(self, *items: Any) -> None:
        """Sends a call without waiting for its reply, which `read_reply` returns."""

    def is_answered(self, patience: float) -> bool:
        """Returns True if the reply to the oldest open call arrives within `patience` [s]."""

    def read_reply(self) -> list[Any]:
        """Returns the reply to the oldest open call."""

    def close(self) -> None:
        """Closes the connection."""


class Network(ABC):
    """A YARP network. Methods raise PortError if the name server does not answer."""

    title: str
    """Name of the implementation of YARP's network, for messages to the user."""
    address: tuple[str, int]
    """Host and port of the name server."""
    dialect: Dialect | None = None
    """The only dialect that this network supports; None if it supports both dialects."""

    @abstractmethod
    def list(self) -> list[Contact]:
        """Returns the address of every port."""

    def lives(self, name: str) -> bool:
        """Returns True if a port is registered and answers."""
        return any(contact.name == name and contact.answers() for contact in self.list())

    @abstractmethod
    def query(self, name: str) -> Contact:
        """Returns the address of a port. Raises UnknownNameError if the port is not registered."""

    @abstractmethod
    def port(
        self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> NamedPort:
        """Opens a port. A thread of the port calls `receive` with each message. If the sender of a message
        expects an answer, `receive` returns this answer."""

    @abstractmethod
    def writer(self, target: str, sender: str) -> Writer:
        """Connects to the port `target` with the carrier fast_tcp. Raises PortError if that fails."""

    @abstractmethod
    def caller(self, target: Contact, sender: str, dialect: Dialect) -> Caller:
        """Returns an object that makes calls to a port, with the carrier tcp. The caller connects at the
        first call, and again after a failure."""
