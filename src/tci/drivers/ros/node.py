"""The interface that a driver or a server needs of ROS: topics only."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tci.errors import DriverError, TciError
from tci.rosmsg.cdr import MessageType

Publish = Callable[[Sequence[Any]], None]
"""Sends one message from its values in the order of `MessageType.flat`."""
Callback = Callable[[Mapping[str, Any]], None]
"""Handles one message, as `tci.rosmsg.cdr.decode` returns it. Errors that it raises are counted and have no
other effect."""
LIFESPAN = 0.1
"""Time [s] after which a message is no longer delivered, if the middleware stores messages. Assumed: older
joint data or commands are stale."""
MOST_REASONS = 100
"""Largest number of reasons that are counted separately. Assumed: bounds memory, since the reasons contain
received text."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)*")


class RosNode(ABC):
    """A node of one kind of ROS. Topics are absolute: `/joint_states`."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        """Messages that could not be decoded, counted by reason."""
        self.silent: set[str] = set()
        """Nodes that are registered for a requested topic but do not answer."""

    @abstractmethod
    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        """Offers a topic; with `latched`, later subscribers still get the last message."""

    @abstractmethod
    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        """Passes messages of a topic to `callback`: between two polls, only the last `keep` messages."""

    @abstractmethod
    def types_of(self, topic: str) -> tuple[str, ...]:
        """Returns the types with which running nodes offer a topic, for messages; empty for no such topic."""

    @abstractmethod
    def close(self) -> None:
        """Closes every topic. A second call does nothing."""

    def poll(self) -> None:  # noqa: B027 - a node with a thread needs none
        """Passes on the messages that have arrived. Nodes with their own thread need not do this."""

    def supports(self, kind: MessageType) -> bool:
        """Returns True if this node can carry messages of a type; it can carry all standard ones."""
        return True

    def _pass_on(self, topic: str, decoded: Callable[[], Mapping[str, Any]], callback: Callback) -> None:
        """Decodes one message and passes it on, or counts it as rejected."""
        try:
            callback(decoded())
        except (TciError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            reason = f"{topic}: {error}"
            self.rejected[reason if len(self.rejected) < MOST_REASONS else f"{topic}: and others"] += 1


def namespace_of(address: str) -> str:
    """Returns the namespace in a driver's address, with a slash before it and none after; "" for none.

    Raises DriverError for an invalid name.
    """
    namespace = "/" + address.strip("/") if address.strip("/") else ""
    if not NAMESPACE.fullmatch(namespace):
        raise DriverError(f"{address!r} is no ROS namespace; valid: letters, digits and _, as in /left/nao")
    return namespace
