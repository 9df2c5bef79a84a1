"""What a driver asks of YARP: ports by name, and what carries messages between them.

Two ways there are, `wire` (pure Python) and `bindings` (YARP's). All else, boards and skin above all, is said
once and knows neither.
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
    """What was wrong with the last message that was not understood."""

    @property
    def outputs(self) -> Sequence[str]:
        """Names of the ports that this one sends to."""

    def write(self, value: Array | Sequence[Any], stamp: Stamp | None = None) -> None:
        """Send a Vector (an array) or a Bottle (a list) to all readers. It never waits; nothing queues."""

    def listen_to(self, source: str, carrier: str) -> None:
        """Have a port send to this one. Raises PortError, also when it refuses."""

    def register(self) -> None:
        """Tell the name server, again after it restarted. Raises PortError."""

    def close(self) -> None:
        """Unregister and let go of every connection."""


class Writer(Protocol):
    """A connection of ours to somebody's port. It never waits."""

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        """Send a Vector (an array) or a Bottle (a list), or drop it. Raises PortError for a lost reader."""

    def is_over(self) -> bool:
        """Whether the reader is gone."""

    def close(self) -> None:
        """Let go."""


class Caller(Protocol):
    """Calls to somebody's port, and their replies. Every failure is a PortError; there is no second try."""

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        """The reply to a call; empty where the other end says nothing."""

    def ask(self, *items: Any) -> None:
        """Send a call without waiting for its reply; `hear` gets it."""

    def answered(self, patience: float) -> bool:
        """Whether the reply to the oldest call that was asked comes within `patience` [s]."""

    def hear(self) -> list[Any]:
        """The reply to the oldest call that was asked."""

    def close(self) -> None:
        """Let go of the connection."""


class Network(ABC):
    """Who is where, and how to talk with them. Methods raise PortError when the name server is silent."""

    title: str
    """What it is, for people."""
    address: tuple[str, int]
    """Host and port of the name server."""
    dialect: Dialect | None = None
    """The only dialect that it speaks; None for both."""

    @abstractmethod
    def list(self) -> list[Contact]:
        """All ports."""

    @abstractmethod
    def query(self, name: str) -> Contact:
        """Where a port is. Raises UnknownNameError for one that is not registered."""

    @abstractmethod
    def port(
        self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> NamedPort:
        """Open a port; `receive` gets each message, from a thread of the port's own, and answers calls."""

    @abstractmethod
    def writer(self, target: str, sender: str) -> Writer:
        """Connect to a port by fast_tcp. Raises PortError."""

    @abstractmethod
    def caller(self, target: Contact, sender: str, dialect: Dialect) -> Caller:
        """Calls to a port, by tcp. The connection is made when it is needed, again after a failure."""
