"""Serves the Inspire hands of a robot on the topics of the maker's bridge: states and touch are sent, and
commands are converted to orders for the gate."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import Any

import numpy as np

from tci.drivers.remote.controllers import movable, position_order
from tci.errors import FrameError
from tci.messages import JointReading, Order, SkinFrame
from tci.messages.clock import Every
from tci.robot.description import Robot
from tci.shared.inspire_dds import ANGLE, CTRL, FULL, LEAVES, PADS, SETS, STATE, TOUCH, decode, encode, topic
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree.inspire_hand import counts, inspire_pads, joints_of, radians

RATE = 50.0
"""Rate [Hz] of states and touch. Assumed: the bridge's is published nowhere; Inspire names 50 Hz."""
WARM = 30
"""Temperature [C] of the served motors."""
REACHED = 2
"""Status of a motor that has reached its angle."""


class ServedInspire:
    """One Inspire hand of a served robot."""

    def __init__(self, robot: Robot, side: str, node: InterfaceNode) -> None:
        """Opens the hand's topics if the robot has joints or patches of an Inspire hand on this side.

        Raises DriverError if a patch has not as many channels as its pad.
        """
        self._robot = robot
        self._servos, self._places = joints_of(robot, side)
        self._pads = inspire_pads(robot, side)
        self.there = bool(len(self._servos) or self._pads)
        """True if the robot has joints or patches on this hand."""
        if not self.there:
            return
        self._commands = node.reader(topic("ctrl", side), CTRL)
        self._states, self._touch = (
            node.out(topic("state", side), STATE),
            node.out(topic("touch", side), TOUCH),
        )
        self._angles = np.full(6, FULL, "<i2")
        self._values: dict[str, Any] = {pad: np.zeros(size, "<i2") for pad, size in PADS.items()}
        self._due = Every(1.0 / RATE)

    def orders(self, now: float, rejected: Counter[str]) -> list[Order]:
        """Orders for the joints, from the commands that arrived since the last call. Commands that can't be
        used are counted by the reason."""
        found: list[Order] = []
        for sample in latest(self._commands):
            command, mode = {"angle_set": np.zeros(0)}, b""
            with suppress(FrameError):
                command, mode = decode(sample.raw, SETS, {})
            wanted = command["angle_set"].astype(float)
            if not mode or not mode[0] & ANGLE or np.any((wanted < LEAVES) | (wanted > FULL)):
                rejected["for a hand, without six angles of -1 to 1000 (mode 1)"] += 1
                continue
            led = wanted[self._places] > LEAVES
            if led.any():
                places = self._places[led]
                order = position_order(self._servos[led], radians(places, wanted[places]))
                kept = movable(order, self._robot)
                found += [] if kept is None else [kept]
        return found

    def publish(self, joints: JointReading, skin: tuple[SkinFrame, ...], now: float) -> None:
        """Sends a state of the joints and the pads, if it is due."""
        if not self._due.due(now):
            return
        self._angles[self._places] = counts(self._places, joints.position[self._servos])
        none = np.zeros(6, "<i2")
        flags = [np.full(6, value, "u1") for value in (0, REACHED, WARM)]
        self._states(encode((FULL - self._angles, self._angles, none, none, *flags)))
        for frame in skin:
            if (pad := self._pads.get(frame.patch)) is not None:
                self._values[pad][:] = np.nan_to_num(frame.values)
        self._touch(encode(self._values.values()))
