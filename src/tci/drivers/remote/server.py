"""Server in the robot's process for the protocol `remote`, over any middleware."""

from __future__ import annotations

import logging
import secrets
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

from tci.drivers.driver import Driver
from tci.drivers.remote.commanders import Commanders
from tci.drivers.remote.protocol import Orders, State
from tci.drivers.server import Server
from tci.errors import FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading, SkinFrame
from tci.reasons import Reason

LISTENS_FOR, LISTENS_EVERY = 0.1, 0.5
"""A server reads the states of others for so long, and so often [s]: reading all of them would cost as much
as sending its own."""
_log = logging.getLogger("tci")


class RemoteServer(Server):
    """Serves a robot to other TCI processes, which command the robot through the gate of this process.

    A subclass transfers messages in `_poll`, `_show` and `_show_skin`. These methods must never wait.
    """

    def __init__(self, driver: Driver, address: str = "", *, middleware: str) -> None:
        """Prepares the server. Raises UnknownNameError if the robot has no binding to `middleware`."""
        super().__init__(driver, address)
        self.number = secrets.randbits(62) + 1
        """Session number: a random number, new for each server."""
        silence = driver.robot.binding(middleware).stale_after
        self.commanders = Commanders(driver.robot, self.number, silence)
        """The processes that command the robot."""
        self._sequence = 0
        self._shown: dict[str, int] = {}
        self._rivals: set[int] = set()

    @property
    def overtaken(self) -> int:
        return self.commanders.overtaken

    @abstractmethod
    def _poll(self) -> Iterable[Orders]:
        """Returns the messages of clients that have arrived, at most a fixed number."""

    @abstractmethod
    def _show(self, state: State) -> None:
        """Sends the state of the robot and its gate to all clients."""

    @abstractmethod
    def _show_skin(self, frame: SkinFrame) -> None:
        """Sends a frame of skin to all clients."""

    def _overhear(self, read: Callable[[], State]) -> None:
        """For wires on which servers hear each other: tells, once, that another process serves this robot in
        the same place, since its behaviours can't tell the two apart. `read` is called for some messages
        only."""
        if time.monotonic() % LISTENS_EVERY > LISTENS_FOR:
            return
        with suppress(FrameError):
            session = read().session
            if session not in (self.number, *self._rivals):
                self._rivals.add(session)
                _log.warning(
                    f"another process serves {self.driver.robot.name} as {self.where()} too, and behaviours "
                    "can't tell the two apart; valid: end one of them, or give it another name or address"
                )

    def fault(self) -> Reason | None:
        for message in self._poll():
            self.commanders.receive(message)
        return self.commanders.fault()

    def orders(self) -> Sequence[Order]:
        return self.commanders.take()

    def refuse(self, order: Order, reason: Reason) -> None:
        self.commanders.refuse(order, reason)

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self.commanders.decided(sent, self.driver.gate.disobey)
        self._sequence += 1
        self._show(
            State(
                session=self.number,
                sequence=self._sequence,
                sent=time.monotonic(),
                now=self.driver.clock.now(),
                joints=reading.joints,
                gate=sent.state.value,
                reason=sent.reason,
                commanders=self.commanders.states(),
                met=sent.met,
            )
        )
        for frame in reading.skin:
            if self._shown.get(frame.patch) != frame.sequence:
                self._shown[frame.patch] = frame.sequence
                self._show_skin(frame)
