"""Interface to ROS for drivers and servers. The interface has topics, but no services or actions."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

from tci.errors import DriverError, TciError
from tci.recording.rosmsg.cdr import MessageType
from tci.shared.ros_types import message_type

Publish = Callable[[Sequence[Any]], None]
"""Function that sends one message. The argument has the values of the message's fields in the order of
`MessageType.flat`: first the header, if the message has one."""
Callback = Callable[[Mapping[str, Any]], None]
"""Function that handles one message. The argument has the fields that
`tci.recording.rosmsg.cdr.decode` returns. If the
function raises an error, the node drops the message and counts the message as rejected."""
LIFESPAN = 0.1
"""Time [s] after which a message that the middleware has stored is no longer delivered. Assumed: older joint
data or commands are useless."""
MOST_REASONS = 100
"""Largest number of reasons of rejected messages that are counted separately. Without a limit, a sender could
fill the memory, since a reason contains text from the message. Assumed: a person reads fewer reasons."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)*")


class RosNode(ABC):
    """A node of one kind of ROS. Names of topics are absolute, e.g. `/joint_states`."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        """Number of rejected messages, by the reason."""
        self.silent: set[str] = set()
        """Names of nodes that do not answer, although ROS lists them as publishers of a topic to which this
        node subscribes."""

    @abstractmethod
    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        """Offers a topic and returns the function that sends a message on this topic. With `latched`, a node
        that subscribes later also receives the last message that was sent.
        """

    @abstractmethod
    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        """Subscribes to a topic and passes the messages to `callback`. If more than `keep` messages arrive
        between two polls, passes only the last `keep` messages."""

    def watch(self, topic: str, type_: str, definitions: str, callback: Callback, *, keep: int = 1) -> None:
        """Subscribes to a topic of any type, and passes the fields of each message to `callback`, those of
        nested messages as mappings.

        Args:
            topic: Name of the topic.
            type_: `package/msg/Name`.
            definitions: File or folder with definitions of the user's; empty for those of installed packages.
            callback: As for `subscribe`.
            keep: As for `subscribe`.

        Raises DriverError if the type is not known.
        """
        self.subscribe(topic, message_type(type_, definitions), callback, keep=keep)

    @abstractmethod
    def types_of(self, topic: str) -> tuple[str, ...]:
        """Returns the message types with which running nodes offer a topic. The result is empty if no node
        offers the topic."""

    def topics(self) -> dict[str, tuple[str, ...]]:
        """The types of every topic that running nodes offer, by its name; empty if the node can't tell."""
        return {}

    @abstractmethod
    def close(self) -> None:
        """Closes every topic. A second call does nothing."""

    def poll(self) -> None:  # noqa: B027 - a node with a thread needs none
        """Calls the callbacks with the messages that have arrived. Does nothing if the node has its own
        thread."""

    def supports(self, kind: MessageType) -> bool:
        """Returns True if this node can transport messages of a type. Every node can transport standard
        messages."""
        return True

    def _pass_on(self, topic: str, decoded: Callable[[], Mapping[str, Any]], callback: Callback) -> None:
        """Calls `callback` with the fields of a message, which the function `decoded` returns. Counts the
        message as rejected if one of them fails."""
        try:
            callback(decoded())
        except (TciError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            reason = f"{topic}: {error}"
            self.rejected[reason if len(self.rejected) < MOST_REASONS else f"{topic}: and others"] += 1


def namespace_of(address: str) -> str:
    """Returns the namespace in a driver's address: "/left" for "left", "/left" or "/left/"; "" for "" or "/".

    Raises DriverError if the namespace is invalid.
    """
    namespace = "/" + address.strip("/") if address.strip("/") else ""
    if not NAMESPACE.fullmatch(namespace):
        raise DriverError(f"{address!r} is no ROS namespace; valid: letters, digits and _, as in /left/nao")
    return namespace


def list_topics(topics: Mapping[str, Sequence[str]], *, like: str, most: int = 12) -> str:
    """Topics with their types, on one line, those first whose names are most like `like`; ROS's own are left
    out."""
    shown = [name for name in topics if not name.endswith(("/rosout", "/rosout_agg", "/parameter_events"))]
    shown.sort(key=lambda name: -SequenceMatcher(None, like, name).ratio())
    words = [f"{name} ({', '.join(topics[name])})" for name in shown[:most]]
    more = [f"and {len(shown) - most} more"] if len(shown) > most else []
    return ", ".join([*words, *more]) or "none"
