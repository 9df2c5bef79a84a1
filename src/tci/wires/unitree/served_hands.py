"""Serves the Dex3 hands of a robot. States of motors and press sensors are sent, and commands are converted
to orders for the gate."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import Any

import numpy as np

from tci.drivers.remote.controllers import movable, position_order
from tci.errors import FrameError
from tci.messages import JointReading, Order, SkinFrame
from tci.robot.description import Robot
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.finger_motors import FOLLOWS
from tci.wires.unitree.hands import fingers_of, pads_of
from tci.wires.unitree.motors import FINGER_MOTORS
from tci.wires.unitree.wire import MOTOR_STATE, PRESS, TAXELS, decode_hand_command, encode_hand


class ServedHand:
    """One Dex3 hand of a served robot."""

    def __init__(self, robot: Robot, side: str, node: InterfaceNode) -> None:
        """Opens the hand's topics if the robot has fingers or patches on this hand.

        Raises DriverError if an address in the binding is invalid.
        """
        self._robot = robot
        self._servos, self._motors = fingers_of(robot, side)
        pads, patches = pads_of(robot, side), {patch.name: patch for patch in robot.patches}
        self._pads = {
            name: np.arange(place.start or 0, (place.start or 0) + patches[name].channels // TAXELS)
            for name, place in pads.items()
        }
        self.there = bool(len(self._servos) or self._pads)
        """True if the robot has fingers or patches on this hand."""
        if not self.there:
            return
        self._commands = node.reader(f"rt/dex3/{side}/cmd", messages.HAND_COMMAND)
        self._states = node.out(f"rt/dex3/{side}/state", messages.HAND_STATE)
        self._state: Any = np.zeros(len(FINGER_MOTORS), MOTOR_STATE)
        self._state["mode"] = np.arange(len(FINGER_MOTORS))
        count = 1 + max((int(places.max()) for places in self._pads.values()), default=-1)
        self._press: Any = np.zeros(count, PRESS)

    def orders(self, now: float, rejected: Counter[str]) -> list[Order]:
        """Orders for the fingers, from the commands that arrived since the last call. Commands that can't be
        used are counted by the reason."""
        found: list[Order] = []
        for sample in latest(self._commands):
            motors: Any = ()
            with suppress(FrameError):
                motors = decode_hand_command(sample.raw)
            if len(motors) != len(FINGER_MOTORS) or not np.isfinite(motors["q"]).all():
                rejected["for a hand, with other motors or angles that are not finite"] += 1
                continue
            led = (motors["mode"] & FOLLOWS != 0) & (motors["mode"] & 0x0F == np.arange(len(motors)))
            own = (led & (motors["kp"] > 0.0))[self._motors]
            if own.any():
                wanted = motors["q"][self._motors[own]].astype(float)
                order = movable(position_order(self._servos[own], wanted), self._robot)
                found += [] if order is None else [order]
        return found

    def publish(self, joints: JointReading, skin: tuple[SkinFrame, ...], now: float) -> None:
        """Sends a state of the hand's motors and press sensors."""
        state, servos = self._state, self._servos
        state["q"][self._motors], state["dq"][self._motors] = joints.position[servos], joints.velocity[servos]
        if joints.torque is not None:
            state["tau_est"][self._motors] = joints.torque[servos]
        for frame in skin:
            if (places := self._pads.get(frame.patch)) is not None:
                self._press["pressure"][places] = np.reshape(frame.values, (-1, TAXELS))
        self._states(encode_hand(state, self._press))
