"""The messages between TCI processes: one process owns the robot, other processes command the robot.

- The robot's process has the gate, the lease and the watchdog. This process sends a `State` in every period
  and each skin frame once.
- A behaviour's process replies with `Orders` in every period, also if the list of orders is empty. So the
  reply also serves as a heartbeat. The reply contains the time stamp of the state, so delays are detected
  without synchronised clocks.
- Orders are repeated until a state acknowledges their number, so a lost datagram has no effect.
- All messages contain the session number of the robot's process. Messages of other sessions are counted and
  ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

from tci.messages import JointReading, Met, PlatformOrder, SkinFrame
from tci.reasons import Reason

MOST_ORDERS = 64
"""Largest number of orders in one message, to bound the length of a message. Assumed: a behaviour sends at
most one order for each robot part in a period."""
HIGHEST = 1 << 62
"""Upper bound of the sequence numbers of orders."""
MOST_COMMANDERS = 16
"""Largest number of processes that may command one robot at a time. Assumed: no robot has more commanders. A
state has an entry for each commander, so this number also bounds the length of a state."""
MOST_WORDS = 2000
"""Largest length [characters] of a reason. Assumed: with this length, the reasons for all commanders fit in
one state."""
MOST_MET = 64
"""Largest number of parts in contact in one state, to bound its length. Assumed: no robot has more parts."""


def shown(text: str, most: int) -> str:
    """Returns at most `most` characters of another process's text, with only printable characters."""
    return "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in text[:most])


@dataclass(frozen=True, slots=True)
class Commander:
    """Part of a state message that describes one commander, a process that commands the robot."""

    client: int
    """Random number of the commander, equal to `Orders.client`."""
    name: str
    """Name of the commander, for messages to the user."""
    acknowledged: int
    """Sequence number of the last order of this commander that the robot's process received; 0 if there is
    none."""
    refused: int
    """Sequence number of the commander's last refused order; 0 if no order was refused."""
    reason: Reason | None
    """Reason for the refusal of the order `refused`."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """State of the robot in one period."""

    session: int
    """Random number of the robot's process. Each start of the process has a new number."""
    sequence: int
    """Number of the state, which increases by one with each state of the session."""
    sent: float
    """Time [s] at which the state was sent, on the monotonic clock of the robot's process."""
    now: float
    """Time [s] at which the state was sent, on the clock of the joints' stamps."""
    joints: JointReading
    gate: str
    """State of the gate: run, hold or stop."""
    reason: Reason | None
    """Reason why the gate holds or stops the robot; None in the state `run`."""
    commanders: tuple[Commander, ...]
    met: tuple[Met, ...] = ()
    """Contacts that the gate of the robot's process notices."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionFrame:
    """A skin frame with the session number of the robot's process."""

    session: int
    """Number of the robot's process, equal to `State.session`."""
    frame: SkinFrame


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """Orders of one behaviour's process, which also serve as its heartbeat."""

    session: int
    """`State.session` of the state to which this message is the reply."""
    seen: float
    """Time [s] at which the state that this message answers was sent, on the monotonic clock of the robot's
    process."""
    client: int
    """Random number of the sender. Each start of the sender has a new number."""
    name: str
    """Host and process of the sender, for messages to the user."""
    sequence: int
    """Number of the message, which increases by one with each message of the client."""
    halt: Reason | None
    """Reason for the robot to hold: the sender's gate is not in the state RUN, or the sender requests a hold.
    None if there is no reason, or if the reason came from the robot's process."""
    leaving: bool
    """True if this is the last message of the sender."""
    first: int
    """Number of the first order in `orders`. The sender numbers its orders consecutively from 1."""
    orders: tuple[PlatformOrder, ...]
    """All orders that no state has acknowledged yet, the oldest first."""
