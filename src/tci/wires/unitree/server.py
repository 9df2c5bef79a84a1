"""Serves a simulated G1 on the topics of a real G1, for the vendor's SDKs and for TCI's driver.

The served robot has a simulated controller instead of a real robot's own controller. After a client has
handed the motors back, the simulated controller keeps the motors' posture. In contrast, the controller of a
real robot moves the arms to another posture. The gate of this process checks all commands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.remote.controllers import movable, position_order
from tci.drivers.server import Server
from tci.errors import FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Order, Perception, Reading
from tci.messages.clock import Every
from tci.reasons import Code, Reason
from tci.shared.interface_node import InterfaceNode, latest
from tci.shared.interfaces import is_loopback
from tci.wires.unitree import messages
from tci.wires.unitree.address import parse_unitree
from tci.wires.unitree.driver import slots_of
from tci.wires.unitree.motors import SIDES, commanded
from tci.wires.unitree.served_hands import ServedHand
from tci.wires.unitree.served_inspire import ServedInspire
from tci.wires.unitree.switcher import SwitcherServer
from tci.wires.unitree.wire import STATE, WEIGHT, decode_command, encode_state

RATE = 500.0
"""Rate [Hz] of states, equal to the rate of a real robot."""
VARIANT = 5
"""Value of the field `mode_machine` in the state of a G1 with 29 motors. The field tells the variant of the
robot."""
WARM, SUPPLY = 30, 50.0
"""Temperature [C] and voltage [V] that the served motors report. Assumed: a robot at rest has these
values."""
AHEAD = 0.01
"""Time [s] by which set-points are extrapolated with their speed. Without extrapolation, the robot would come
to rest at each set-point, and would begin to move 12 ms late. Assumed: with this time, a stop overshoots by
less than 2 mrad."""
ELSEWHERE = 2e-3
"""A received set-point counts as a command if it has changed, or if its weighted mean with the simulated
controller's set-point differs from the latter by more than this angle [rad]. Assumed: for a joint that must
not move, a program keeps sending one measured angle. Noise and gravity cause a smaller difference."""


class UnitreeServer(Server):
    """Server that presents a robot as a Unitree G1."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Opens the topics at the address INTERFACE[/DOMAIN]. By default, only programs on this machine can
        use these topics. Raises DriverError if the address is invalid or the domain can't be opened.
        """
        super().__init__(driver, address)
        self._where = parse_unitree(address, usual="lo")
        slots = slots_of(driver.robot)
        self._body = np.flatnonzero(slots >= 0)
        self._slots = slots[self._body]
        self.rejected: Counter[str] = Counter()
        """Number of received commands that were not used, for each reason."""
        self._state: Any = np.zeros((), STATE)
        self._state["mode_machine"], self._state["quaternion"][0] = VARIANT, 1.0
        self._state["accelerometer"][2] = 9.81
        motors = self._state["motor"]
        motors["mode"][self._slots], motors["vol"][self._slots] = 1, SUPPLY
        motors["temperature"][self._slots] = WARM
        self._due = Every(1.0 / RATE)
        self._own: Any = None
        self._shown: int | None = None
        self._first = np.full(len(driver.robot.servos), np.nan)
        self._moved = np.zeros(len(driver.robot.servos), dtype=bool)
        self._silent: float | None = None
        self._node = InterfaceNode(self._where.interface, self._where.domain)
        self._arms = self._node.reader("rt/arm_sdk", messages.COMMAND)
        self._all = self._node.reader("rt/lowcmd", messages.COMMAND)
        self._states = self._node.out("rt/lowstate", messages.STATE)
        self.switcher = SwitcherServer(self._node)
        kinds = (ServedHand, ServedInspire)
        hands = [kind(driver.robot, side, self._node) for kind in kinds for side in SIDES]
        self._hands = [hand for hand in hands if hand.there]

    def where(self) -> str:
        everybody = "" if is_loopback(self._where.interface) else ", read and commanded by everybody there"
        return f"unitree:{self._where}{everybody}"

    def orders(self) -> Sequence[Order]:
        self.switcher.poll()
        now = self.driver.clock.now()
        found: list[Order] = []
        balanced = bool(self.switcher.name)
        for reader, arms in ((self._arms, True), (self._all, False)):
            for sample in latest(reader):
                command = self._command(sample.raw)
                if command is None or self._own is None:
                    continue
                if arms is not balanced:
                    self.rejected["for the other control than motion_switcher has selected"] += 1
                    continue
                self._silent = now if not arms or command["motor"]["q"][WEIGHT] > 0.0 else None
                if (order := self._order(command["motor"], arms=arms)) is not None:
                    found.append(order)
        for hand in self._hands:
            found += hand.orders(now, self.rejected)
        return found

    def fault(self) -> Reason | None:
        silence = self.driver.robot.binding("unitree").stale_after
        if self._silent is None or self.driver.clock.now() - self._silent <= silence:
            return None
        return Reason(Code.COMMANDER_SILENT, f"no command for {silence * 1e3:.0f} ms")

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        joints = reading.joints
        if self._own is None:
            self._own = np.array(joints.position)
        if not self._due.due(self.driver.clock.now()):
            return
        if joints.sequence != self._shown:  # a state that is sent twice would look like a new state
            self._shown = joints.sequence
            self._show(joints)
        for hand in self._hands:
            hand.publish(joints, reading.skin, self.driver.clock.now())

    def _show(self, joints: JointReading) -> None:
        """Sends a state message with the measured values of the joints to all clients."""
        motors = self._state["motor"]
        body, slots = self._body, self._slots
        motors["q"][slots], motors["dq"][slots] = joints.position[body], joints.velocity[body]
        if joints.torque is not None:
            motors["tau_est"][slots] = joints.torque[body]
        self._state["tick"] = int(joints.stamp * 1e3) & 0xFFFFFFFF
        self._states(encode_state(self._state))

    def refuse(self, order: Order, reason: Reason) -> None:
        self.rejected[reason.text] += 1

    def close(self) -> None:
        self._node.close()

    def _command(self, data: bytes) -> Any:
        """Returns the command in a message; None if the command is not valid for this robot."""
        try:
            command, right = decode_command(data)
        except FrameError:
            self.rejected["of another size"] += 1
            return None
        if not right:
            self.rejected["with a wrong checksum"] += 1
        elif command["mode_machine"] != VARIANT:
            self.rejected["with another mode_machine"] += 1
        elif not all(np.isfinite(command["motor"][name]).all() for name in ("q", "dq")):
            self.rejected["with angles or speeds that are not finite"] += 1
        else:
            return command
        return None

    def _order(self, motors: Any, *, arms: bool) -> Order | None:
        """Returns an order to move those motors that a client has told to move; None if there are none. With
        `arms` (commands on rt/arm_sdk), each set-point is the mean of the client's and the simulated
        controller's set-points, weighted with the client's weight.
        """
        weight = float(np.clip(motors["q"][WEIGHT], 0.0, 1.0)) if arms else 1.0
        slots = commanded(whole=not arms)
        enabled = slots[(motors["mode"][slots] == 1) & (motors["kp"][slots] > 0.0)]
        own = np.isin(self._slots, enabled)
        servos = self._body[own]
        if not servos.size:
            return None
        wanted, speed = (motors[name][self._slots[own]].astype(float) for name in ("q", "dq"))
        mixed = weight * wanted + (1.0 - weight) * self._own[servos]
        if weight == 0.0:
            self._first[:] = np.nan
        first = self._first[servos] = np.where(np.isnan(self._first[servos]), wanted, self._first[servos])
        self._moved[servos] |= (wanted != first) | (np.abs(mixed - self._own[servos]) > ELSEWHERE)
        if weight >= 1.0:
            self._own[servos] = mixed
        led = self._moved[servos]
        if not led.any():
            return None
        targets = mixed + weight * speed * AHEAD
        return movable(position_order(servos[led], targets[led]), self.driver.robot)
