"""Handles commands to all servos of a robot part in which some servos can't be moved.

Programs for control boards command all joints of a board, including joints without known limits, which can't
be moved. A joint that can't be moved keeps its position, and the other joints follow the command. If no joint
of a command can be moved, the command is refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tci.errors import CommandError
from tci.gate.acceptance import check_limits
from tci.messages import PlatformCommand, PlatformOrder
from tci.robot.description import Robot, Servo


class Immovable:
    """The servos of a robot that can't be moved, because the description lacks one of their limits."""

    def __init__(self, robot: Robot) -> None:
        names = dict.fromkeys(servo.robot_part for servo in robot.servos)
        parts = {name: robot.servos_of(name) for name in names}
        self._parts = [
            ({servo.index for servo in servos}, fixed)
            for servos in parts.values()
            if (fixed := {servo.index for servo in servos if not is_movable(servo)})
        ]

    def left_out(self, order: PlatformOrder) -> PlatformOrder:
        """Returns the order, in which the immovable servos of a robot part are left out if the order contains
        all servos of this part. If no servo would remain, returns the order unchanged."""
        if not self._parts or order.servos.ndim != 1:
            return order
        named = {*order.servos.tolist()}
        fixed = {servo for part, still in self._parts if part <= named for servo in still}
        if not fixed or fixed == named:
            return order
        kept = np.array([servo not in fixed for servo in order.servos.tolist()])
        if not isinstance(order, PlatformCommand):
            return replace(order, servos=order.servos[kept])
        if not order.values.shape == order.speed.shape == order.servos.shape:
            return order
        return replace(order, servos=order.servos[kept], values=order.values[kept], speed=order.speed[kept])


def is_movable(servo: Servo) -> bool:
    """Returns True if the description contains all limits that the gate needs to move a servo."""
    try:
        check_limits(servo)
    except CommandError:
        return False
    return True
