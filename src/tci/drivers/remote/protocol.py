"""What two TCI processes tell each other: one owns the robot (gate, lease, watchdog), others command it.

The robot's process sends a `State` in every period and each skin frame once. A behaviour's process answers
with `Orders` in every period, also with none: that is its heartbeat. Orders carry the time of the state that
they answer, so what was delayed on the way is found out without comparing clocks. They are repeated until a
state acknowledges their number, so a lost datagram loses nothing. All three carry the session of the
robot's process: what another one sends is counted and ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

from tci.messages import JointReading, PlatformOrder, SkinFrame
from tci.reasons import Reason

MOST_ORDERS = 64
"""Orders that one message may carry. Ours."""
HIGHEST = 1 << 62
"""Numbers of orders are below it."""
MOST_COMMANDERS = 16
"""Processes that may command one robot at a time. Ours."""
MOST_WORDS = 2000
"""Characters of a reason, so that those for all commanders fit in one state. Ours."""


def shown(text: str, most: int) -> str:
    """What others sent for people to read: at most `most` characters, all of them such as can be printed."""
    return "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in text[:most])


@dataclass(frozen=True, slots=True)
class Commander:
    """What a state says to one of those that command."""

    client: int
    """Its number."""
    name: str
    """Who it is, for people."""
    acknowledged: int
    """Number of its last order that was handled."""
    refused: int
    """Number of its last order that was refused; 0 for none."""
    reason: Reason | None
    """Reason why it was."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The robot in one period."""

    session: int
    """Number of the robot's process, another one after each start."""
    sequence: int
    """Counts up by one with each state of the session."""
    sent: float
    """When it was sent [s], on the process's monotonic clock."""
    now: float
    """The same instant [s] on the clock of the joint stamps."""
    joints: JointReading
    gate: str
    """State of the gate: run, hold, stop."""
    reason: Reason | None
    """Reason why it holds or has stopped; None while it runs."""
    commanders: tuple[Commander, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SessionFrame:
    """A frame of skin, and whose it is."""

    session: int
    """Number of the robot's process, as in its states."""
    frame: SkinFrame


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """What one behaviour's process wants, and that it is alive."""

    session: int
    """Of the state that it answers."""
    seen: float
    """`sent` [s] of that state."""
    client: int
    """Number of the sender, another one after each start."""
    name: str
    """Who it is, for people: host and process."""
    sequence: int
    """Counts up by one with each message of the client."""
    halt: Reason | None
    """Reason why the robot should hold, as the sender's own gate does; None while that runs."""
    leaving: bool
    """Whether this is the last message."""
    first: int
    """Number of the first of `orders`; numbers count up by one from 1."""
    orders: tuple[PlatformOrder, ...]
    """All that are not acknowledged yet, oldest first."""
