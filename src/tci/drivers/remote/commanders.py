"""The processes that command a served robot.

Stale messages are dropped, each joint is granted to only one process, and each order is executed only once.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

from tci.drivers.remote.protocol import MOST_COMMANDERS, MOST_ORDERS, MOST_WORDS, Commander, Orders
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, PlatformOrder
from tci.reasons import Code, Reason
from tci.robot.description import Robot

LEASE = 1.0
"""Time [s] for which a commander keeps its joints after its last message. Until then, no other process may
command these joints. Assumed: the robot comes to rest within this time."""


@dataclass(slots=True)
class _Member:
    """One process that commands the robot."""

    name: str
    last_message: float
    """Arrival time [s] of the process's last message that was accepted."""
    sequence: int = 0
    acknowledged: int = 0
    refused: int = 0
    reason: Reason | None = None
    halt: Reason | None = None
    servos: set[int] = field(default_factory=set)
    """Indices of the servos that only this process may command."""


class Commanders:
    """The processes (commanders) that command one robot, and who may move which joint.

    Every message of a commander is the reply to a state of the robot. A message is accepted only if

    - the state belongs to this session and was sent at most `silence` [s] ago, and
    - the state is more recent than the commander's last disconnection.

    Delayed or recorded messages are therefore dropped and move nothing. The robot holds in two cases: a
    commander that has joints under command has sent nothing for more than `silence` [s], or the gate in the
    commander's process holds.
    """

    def __init__(
        self, robot: Robot, session: int, silence: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._robot = robot
        self._session = session
        self._silence = silence
        self._clock = clock
        self._members: dict[int, _Member] = {}
        self._waiting: deque[tuple[int, int, float, PlatformOrder]] = deque(
            maxlen=MOST_ORDERS * MOST_COMMANDERS
        )
        self._taken: list[tuple[int, int, PlatformOrder]] = []
        self._left: Reason | None = None
        self._gone: dict[int, float] = {}
        self._disobey: dict[int, float] = {}
        self.overtaken = 0
        """Number of orders that were on their way while their part met something: their senders had not seen
        it, and were told."""
        self.rejected = 0
        """Number of rejected messages.

        Reasons are: the message is late, is repeated, belongs to another session, or is from a process that
        has disconnected. A message of a new process is also rejected if the robot already has MOST_COMMANDERS
        commanders.
        """

    def receive(self, message: Orders) -> None:
        """Checks and stores a message of a commander."""
        now = self._clock()
        member = self._members.get(message.client)
        fresh = message.session == self._session and 0.0 <= now - message.seen <= self._silence
        full = member is None and len(self._members) >= MOST_COMMANDERS
        gone = message.seen <= self._gone.get(message.client, -math.inf)
        if not fresh or full or gone or (member is not None and message.sequence <= member.sequence):
            self.rejected += 1
            return
        if member is None:
            member = self._members[message.client] = _Member(message.name, now)
        member.last_message, member.sequence, member.halt = now, message.sequence, message.halt
        if message.halt:  # it has dropped the orders that are still on their way: they are not refused
            kept = [one for one in self._waiting if one[0] != message.client]
            self._waiting = deque(kept, self._waiting.maxlen)
        for number, order in enumerate(message.orders, start=message.first):
            if number > member.acknowledged:
                member.acknowledged = number
                self._waiting.append((message.client, number, message.seen, order))
        if message.leaving:
            self._gone = {client: seen for client, seen in self._gone.items() if now - seen <= self._silence}
            self._gone[message.client] = message.seen
            self._forget(message.client, Reason(Code.COMMANDER_LEFT, f"{member.name} has disconnected"))

    def fault(self) -> Reason | None:
        """Returns a reason if the robot must hold, otherwise None.

        Reasons are: a commander is silent, the gate in a commander's process holds, or a commander has just
        disconnected.
        """
        now = self._clock()
        reason, self._left = self._left, None
        for client, member in list(self._members.items()):
            silent = now - member.last_message
            if silent > self._silence + LEASE:
                self._forget(client, None)
            elif silent > self._silence and member.servos:
                words = f"no message from {member.name} for {self._silence * 1e3:.0f} ms"
                reason = reason or Reason(Code.COMMANDER_SILENT, words)
            elif member.halt and member.servos:
                reason = reason or Reason(Code.COMMANDER_HOLDS, f"{member.name} holds: {member.halt}")
        return reason

    def take(self) -> list[PlatformOrder]:
        """Returns the orders for the gate, the oldest first.

        Refuses orders for joints that another commander has under command, and those that were sent before
        their sender could see that the joints obey nobody any more.
        """
        self._taken = []
        while self._waiting:
            client, number, seen, order = self._waiting.popleft()
            member = self._members.get(client)
            if member is None:
                continue
            wanted = {servo for servo in order.servos.tolist() if 0 <= servo < len(self._robot.servos)}
            if owner := self._owner(client, wanted):
                self._refuse(client, number, owner)
                continue
            member.servos |= wanted
            if any(seen < self._disobey.get(servo, -math.inf) for servo in wanted):
                self.overtaken += 1
                words = "an order was on its way while its part met something"
                self._refuse(client, number, Reason(Code.OVERTAKEN, words))
                continue
            self._taken.append((client, number, order))
        return [order for _, _, order in self._taken]

    def refuse(self, order: Order, reason: Reason) -> None:
        """Records that `order`, which `take` had returned, was refused before it reached the gate."""
        for place, (client, number, taken) in enumerate(self._taken):
            if taken is order:
                self._refuse(client, number, reason)
                del self._taken[place]
                return

    def decided(self, sent: SafeCommand, disobey: Collection[int] = ()) -> None:
        """Records which orders the gate refused, and why, and which servos `disobey` from now on, as the next
        state says. An order that it had accepted before belongs to the commander of its joints."""
        now = self._clock()
        self._disobey = {servo: self._disobey.get(servo, now) for servo in disobey}
        taken = {id(order): (client, number) for client, number, order in self._taken}
        for order, reason in sent.refused:
            if id(order) in taken:
                self._refuse(*taken[id(order)], reason)
                continue
            for client, member in self._members.items():
                if not member.servos.isdisjoint(order.servos.tolist()):
                    self._refuse(client, member.acknowledged, reason)
        self._taken = []

    def states(self) -> tuple[Commander, ...]:
        """Returns one entry for each commander. The server sends these entries in its next state message."""
        return tuple(
            Commander(client, member.name, member.acknowledged, member.refused, member.reason)
            for client, member in self._members.items()
        )

    def _owner(self, client: int, servos: set[int]) -> Reason | None:
        for other, member in self._members.items():
            if other != client and (shared := servos & member.servos):
                names = ", ".join(self._robot.servos[servo].name for servo in sorted(shared))
                words = f"{names}: commanded by {member.name} already; valid: one commander per joint"
                return Reason(Code.OTHER_COMMANDER, words)
        return None

    def _refuse(self, client: int, number: int, reason: Reason) -> None:
        if member := self._members.get(client):
            member.refused, member.reason = number, replace(reason, text=reason.text[:MOST_WORDS])

    def _forget(self, client: int, reason: Reason | None) -> None:
        member = self._members.pop(client)
        if member.servos:
            self._left = reason
