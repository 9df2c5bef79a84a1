"""Torques from the currents of a NAO's motors.

NAOqi reports amperes. Neither their sign nor the constants of motors and gears are published. So the constant
is a setting of each joint (`JointCalibration.amperes`), and a motor is assumed to push towards its commanded
angle, as a position controller does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tci.drivers.naoqi import words
from tci.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_calibration import joint_calibration


class Currents:
    """The currents of those servos whose constant is known."""

    def __init__(self, robot: Robot, names: Sequence[str]) -> None:
        """Takes the robot's own `names` (n,) of its joints. Raises the errors of `joint_calibration`."""
        known = joint_calibration(robot).amperes
        servos = [servo.index for servo in robot.servos if servo.name in known]
        self._count, self._servos = len(robot.servos), np.array(servos, dtype=np.intp)
        self._constants = np.array([known[robot.servos[servo].name] for servo in servos])
        chosen = [names[servo] for servo in servos]
        self.keys = [
            *(words.current_key(name) for name in chosen),
            *(words.angle_key(name, "Actuator") for name in chosen),
        ]
        """ALMemory's keys of currents and commanded angles; none without a constant."""

    def torque(self, values: Sequence[Any], position: Array) -> Array:
        """Returns torques (n,) [N m] from the values of `keys` at measured angles (n,) [rad]; NaN for a servo
        without a constant or without a number."""
        numbers = [value if isinstance(value, int | float) else np.nan for value in values]
        amperes, wanted = np.array(numbers, dtype=float).reshape(2, -1)
        torque = np.full(self._count, np.nan)
        torque[self._servos] = self._constants * np.abs(amperes) * np.sign(wanted - position[self._servos])
        return read_only(torque)
