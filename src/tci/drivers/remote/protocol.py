"""The messages between two TCI processes: one owns the robot (gate, lease, watchdog), others command it.

The robot's process sends a `State` in every period and each skin frame once. A behaviour's process replies
with `Orders` in every period, even without orders; this is its heartbeat. The reply contains the stamp of the
state, so delays are detected without synchronised clocks. Orders are repeated until a state acknowledges
their number, so a lost datagram has no effect. All three carry the session of the robot's process: messages
of other sessions are counted and ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

from tci.messages import JointReading, PlatformOrder, SkinFrame
from tci.reasons import Reason

MOST_ORDERS = 64
"""Largest number of orders in one message. Assumed: bounds the message; a behaviour sends one for each part
in a period."""
HIGHEST = 1 << 62
"""Upper bound of the numbers of orders."""
MOST_COMMANDERS = 16
"""Largest number of processes that may command one robot at a time. Assumed: bounds the state, which has an
entry for each."""
MOST_WORDS = 2000
"""Longest reason [characters]. Assumed: the reasons for all commanders fit in one state."""


def shown(text: str, most: int) -> str:
    """Returns a text of another process in printable form: at most `most` characters, all of them
    printable."""
    return "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in text[:most])


@dataclass(frozen=True, slots=True)
class Commander:
    """Part of a state for one commander."""

    client: int
    """Number of the commander."""
    name: str
    """Name of the commander, for messages."""
    acknowledged: int
    """Number of its last order that was handled."""
    refused: int
    """Number of its last order that was refused; 0 for none."""
    reason: Reason | None
    """Reason for the refusal."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """State of the robot in one period."""

    session: int
    """Number of the robot's process, a new one after each start."""
    sequence: int
    """Number of the state, which increases by one with each state of the session."""
    sent: float
    """Time [s] of sending on the process's monotonic clock."""
    now: float
    """Time [s] of sending on the clock of the joint stamps."""
    joints: JointReading
    gate: str
    """State of the gate: run, hold, stop."""
    reason: Reason | None
    """Reason why it holds or has stopped; None while it runs."""
    commanders: tuple[Commander, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SessionFrame:
    """A frame of skin with its session."""

    session: int
    """Number of the robot's process, as in its states."""
    frame: SkinFrame


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """Orders of one behaviour's process, which also serve as its heartbeat."""

    session: int
    """Session of the state to which it is the reply."""
    seen: float
    """`sent` [s] of the state to which it is the reply."""
    client: int
    """Number of the sender, a new one after each start."""
    name: str
    """Name of the sender, for messages: host and process."""
    sequence: int
    """Number of the message, which increases by one with each message of the client."""
    halt: Reason | None
    """Reason for which the sender's own gate holds, so that the robot should hold too; None while that gate
    runs."""
    leaving: bool
    """True if this is the last message."""
    first: int
    """Number of the first of `orders`; orders are numbered consecutively from 1."""
    orders: tuple[PlatformOrder, ...]
    """All orders that are not acknowledged yet, oldest first."""
