"""The keeper: a process that controls a robot's motors for a behaviour, and always hands the motors back at
the end.

The driver starts the keeper and sends set-points to it over a socket. The keeper sends the set-points to the
robot and also checks the robot's states. If the behaviour's process ends or is killed, the socket closes, and
the keeper hands the motors back slowly (`handover`).
"""

from __future__ import annotations

import json
import select
import signal
import socket
import struct
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError, FrameError, TciError
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.handover import Handover, Phase
from tci.wires.unitree.health import STALE, Health
from tci.wires.unitree.motors import MOTORS, SENT, TARGET, absent, commanded, gains
from tci.wires.unitree.wire import COMMAND, WEIGHT, decode_state, encode_command

TAKE, GIVE, FOLLOW = b"T", b"G", b"F"
"""Kinds of messages from the driver to the keeper: take the motors, which need these torques to hold their
links, give them back, and follow new targets. The kind is the first byte of a message."""
TAKES = struct.Struct(f"<c{MOTORS}d")
FOLLOWS = struct.Struct(f"<c{MOTORS}?{MOTORS * TARGET.itemsize}s")
STATUS = struct.Struct("<B?d")
"""First values of a status message: the phase of the handover, True after a fault that lasts until a person
connects again, and the degree (0..1) to which TCI has taken the motors (`Handover.weight`). The rest of the
message is the reason of the fault as text."""
DISCOVERY = 0.5
"""Time [s] for which the keeper searches for other programs that write commands. The time starts with the
first state, and only after this time the keeper takes the motors. Assumed: DDS participants answer a new
participant immediately."""
SILENT = 1.0
"""Time [s] without targets after which the behaviour counts as failed, and the motors are handed back.
Assumed: a pause of a loop is far shorter."""
LOOK = 0.1
"""Time [s] between two searches for other programs that write commands. Assumed: a person needs more time to
start a program."""
GRACE = 0.1
"""Time [s], from the robot's first state on, during which the keeper ignores commands of other programs.
Reason: the robot's own controller may have sent a last command before it was switched off. Assumed: this
command arrives within this time."""
LAST = 5
"""Number of times that the keeper repeats its last command. Over rt/arm_sdk, this command sets the weight of
TCI's targets to 0, which hands the motors back. Assumed: at most four of these messages are lost."""


@dataclass(frozen=True, slots=True)
class Orders:
    """Settings of the keeper, from its command line."""

    interface: str
    domain: int
    topic: str
    whole: bool
    simulation: bool
    period: float
    socket: int


class Keeper:
    """Passes targets from the driver's socket to the robot's motors while the robot, the driver and the
    network have no fault."""

    def __init__(self, orders: Orders, node: InterfaceNode, driver: socket.socket) -> None:
        self._topic, self._whole = orders.topic, orders.whole
        self._node, self._driver = node, driver
        self._states = node.reader("rt/lowstate", messages.STATE)
        self._write = node.out(orders.topic, messages.COMMAND)
        self._others = node.reader(orders.topic, messages.COMMAND, foreign=True)
        self.health = Health(simulation=orders.simulation)
        self.handover = Handover(gains(whole=orders.whole), whole=orders.whole)
        self._command: Any = np.zeros((), COMMAND)
        self._commanded = commanded(whole=orders.whole)
        self.leaving = False
        """True if the keeper must hand the motors back and end."""
        self._wanted = False
        self._holds = np.zeros(MOTORS)
        self._followed: float | None = None
        self._first: float | None = None
        self._looked = -np.inf
        self._reason = ""
        self._told = b""

    def take_over(self, state: Any, goal: NDArray[np.void], weight: float, now: float) -> None:
        """Takes over from a keeper that was killed, and begins to hand the motors back to the robot's own
        controller.

        `goal` (29,) has the last `TARGET`s of that keeper, and `weight` is the last weight of these targets.
        `state` is the robot's latest state.
        """
        self._address(state)
        self.leaving = True
        self.handover.resume(goal, weight, now)

    def step(self, now: float) -> bool:
        """Executes one period at the time `now` [s]. Returns False if the keeper must end."""
        self._hear(now)
        self._read(now)
        self._judge(now)
        before = self.handover.phase
        if before is Phase.WAITING:
            if self.leaving:
                return False
            self._take(now)
        else:
            self._send(targets := self.handover.step(now))
            if self.handover.phase is Phase.WAITING:  # the motors are handed back
                for _ in range(LAST):
                    self._send(targets)
        self._report()
        return True

    def _hear(self, now: float) -> None:
        """Reads and checks the robot's latest states."""
        for sample in latest(self._states):
            try:
                state, right = decode_state(sample.raw)
            except FrameError:
                self.health.wrong += 1
                continue
            away = self.health.state is not None and self.health.age(now) > STALE
            before = self.health.posture if away else None
            if not self.health.see(state, right, now):
                continue
            self._first = now if self._first is None else self._first
            if before is not None and self.handover.phase is not Phase.WAITING:
                self.handover.give_unseen(before, self.health.posture)

    def _read(self, now: float) -> None:
        """Reads and obeys the driver's messages. If several messages contain targets, only the latest one has
        an effect."""
        targets = b""
        while True:
            try:
                message = self._driver.recv(FOLLOWS.size)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if not message:
                self._leave("the behaviour's process has ended")
                break
            if message == GIVE:
                self._leave("")
            elif len(message) == TAKES.size:
                self._wanted, self._followed = True, None
                _, *holds = TAKES.unpack(message)
                self._holds = np.array(holds)
            elif len(message) == FOLLOWS.size:
                targets = message
        if targets and self.health.state is not None:
            _, *these, packed = FOLLOWS.unpack(targets)
            chosen, goal = np.array(these), np.frombuffer(packed, TARGET)
            if np.isfinite(goal.view(float)).all():
                self._followed = now
                self.handover.follow(chosen, goal, self.health.posture, now)

    def _leave(self, why: str) -> None:
        self.leaving, self._reason = True, why

    def _judge(self, now: float) -> None:
        """Begins to hand the motors back in these cases: the driver requests it, the robot has a fault, the
        robot's states are too old, the behaviour sends no targets, or another program commands the robot.
        """
        if now - self._looked > LOOK:
            self._looked = now
            # A received command counts even if the robot's own participant sent the command, since Unitree's
            # SDK in C++ may use one participant for the robot and for the program.
            settled = self._first is not None and now - self._first > GRACE
            words = self._node.fault_of_writers(self._topic, heard=settled and bool(latest(self._others)))
            self.health.lasting = self.health.lasting or words
        silent = self._followed is not None and now - self._followed > SILENT
        why = self.health.lasting or self.health.passing(now)
        if not why and silent and self.handover.phase is Phase.LEADING:
            why = f"the behaviour has sent nothing for {now - (self._followed or now):.1f} s"
        if why:
            self._reason = why
        if (why or self.leaving) and self.handover.phase is not Phase.WAITING:
            self._wanted = False
            self.handover.give()
        elif not why and self.handover.phase is Phase.LEADING:
            self._reason = ""

    def _take(self, now: float) -> None:
        """Begins to take the motors if the driver has requested this, the robot has no fault, and the search
        for other commanding programs has had enough time."""
        if not self._wanted or self.health.lasting or self.health.passing(now):
            return
        if self._first is None or now - self._first < DISCOVERY:
            return
        self._address(self.health.state)
        self.handover.take(self.health.posture, now, self._holds)

    def _address(self, state: Any) -> None:
        """Prepares the command for the robot's variant in `state`, and excludes motors that this variant
        lacks."""
        gone = absent(int(state["mode_machine"]), simulation=True)
        self._commanded = np.setdiff1d(self._commanded, gone)
        self._command["mode_pr"], self._command["mode_machine"] = state["mode_pr"], state["mode_machine"]

    def _send(self, targets: Any) -> None:
        """Sends the `TARGET`s (29,) to the robot. Motors that TCI does not command stay disabled."""
        motor, these = self._command["motor"], self._commanded
        motor["mode"][these] = 1
        for name in SENT:
            motor[name][these] = targets[name][these]
        if not self._whole:
            motor["q"][WEIGHT] = self.handover.weight
        with suppress(DriverError):  # the next command may be sent again
            self._write(encode_command(self._command))

    def _report(self) -> None:
        """Sends a status message to the driver if the status has changed."""
        handover = self.handover
        status = STATUS.pack(handover.phase, bool(self.health.lasting), handover.weight)
        status += self._reason.encode()[:400]
        if status != self._told:
            try:
                self._driver.send(status)
                self._told = status
            except BlockingIOError:
                pass  # if the driver does not read the socket, the status is sent later
            except OSError:
                self.leaving = True


def keep(keeper: Keeper, driver: socket.socket, period: float) -> None:
    """Executes a step of the keeper once per `period` [s], and immediately when a message arrives, until the
    motors are handed back."""
    poll = select.poll()
    poll.register(driver, select.POLLIN)
    due = time.monotonic()
    while keeper.step(time.monotonic()):
        due = max(due + period, time.monotonic())
        if keeper.leaving:  # a closed socket would always be ready to read
            time.sleep(max(0.0, due - time.monotonic()))
        else:
            poll.poll(max(0.0, due - time.monotonic()) * 1e3)


def main() -> None:
    """Runs the keeper. The command line of this process has one argument: `Orders` as JSON."""
    orders = Orders(**json.loads(sys.argv[1]))
    driver = socket.socket(fileno=orders.socket)
    driver.setblocking(False)
    try:
        node = InterfaceNode(orders.interface, orders.domain)
        keeper = Keeper(orders, node, driver)
    except TciError as error:
        driver.send(STATUS.pack(Phase.WAITING, True, 0.0) + str(error).encode())
        return

    def leave(number: int, frame: FrameType | None) -> None:
        keeper.leaving = True

    signal.signal(signal.SIGTERM, leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    keep(keeper, driver, orders.period)
    node.close()


if __name__ == "__main__":
    main()
