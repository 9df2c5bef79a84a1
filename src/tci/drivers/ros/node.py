"""What a driver or a server needs of ROS: topics, and nothing else."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tci.errors import DriverError, TciError
from tci.rosmsg.cdr import MessageType

Publish = Callable[[Sequence[Any]], None]
"""Sends one message, given its values in the order of `MessageType.flat`."""
Hear = Callable[[Mapping[str, Any]], None]
"""Takes one message, as `tci.rosmsg.cdr.decode` gives it. What it raises is counted, and no more."""
LIFESPAN = 0.1
"""Time [s] after which a message is not delivered any more, where the middleware keeps messages. Ours."""
MOST_REASONS = 100
"""Different reasons that are kept apart. Ours."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)*")


class RosNode(ABC):
    """A node of one of the ROS kinds. Topics are absolute: `/joint_states`."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        """Messages that could not be understood, by reason."""
        self.silent: set[str] = set()
        """Nodes that are registered for a topic that was asked for, and do not answer."""

    @abstractmethod
    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        """Offer a topic; `latched`: who comes late still gets the last message."""

    @abstractmethod
    def subscribe(
        self, topic: str, kind: MessageType, hear: Hear, *, latched: bool = False, keep: int = 1
    ) -> None:
        """Hand on each message of a topic to `hear`, but between two polls only the last `keep`."""

    @abstractmethod
    def types_of(self, topic: str) -> tuple[str, ...]:
        """Types that others, who are alive, offer a topic with, for people; empty for no such topic."""

    @abstractmethod
    def close(self) -> None:
        """Let go of every topic. A second call does nothing."""

    def poll(self) -> None:  # noqa: B027 - a node with a thread needs none
        """Hand on what has arrived, where no thread does."""

    def knows(self, kind: MessageType) -> bool:
        """Whether this node can carry messages of a type; standard ones always."""
        return True

    def _hand_on(self, topic: str, decoded: Callable[[], Mapping[str, Any]], hear: Hear) -> None:
        """Let one message be decoded and heard, or be counted as of no use."""
        try:
            hear(decoded())
        except (TciError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            reason = f"{topic}: {error}"
            self.rejected[reason if len(self.rejected) < MOST_REASONS else f"{topic}: and others"] += 1


def namespace_of(address: str) -> str:
    """The namespace in a driver's address, with a slash before it and none behind; "" for none.

    Raises DriverError for what is no name.
    """
    namespace = "/" + address.strip("/") if address.strip("/") else ""
    if not NAMESPACE.fullmatch(namespace):
        raise DriverError(f"{address!r} is no ROS namespace; valid: letters, digits and _, as in /left/nao")
    return namespace
