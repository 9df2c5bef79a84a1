"""Joint torques, computed from the motor currents of a NAO.

NAOqi reports motor currents [A]. Neither the sign of the currents nor the constants of motors and gears are
published. Therefore the constant [N m/A] is a setting of each joint (`JointCalibration.amperes`). The sign of
the torque is an assumption: a motor pushes towards its commanded angle, as a position controller does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_calibration import joint_calibration
from tci.wires.naoqi import words


class Currents:
    """Converts the currents of all servos with a known constant to torques."""

    def __init__(self, robot: Robot, names: Sequence[str]) -> None:
        """Prepares the conversion. `names` (n,) are the robot's own joint names. Raises TciError if the
        robot's calibration file is faulty or belongs to another robot."""
        known = joint_calibration(robot).amperes
        servos = [servo.index for servo in robot.servos if servo.name in known]
        self._count, self._servos = len(robot.servos), np.array(servos, dtype=np.intp)
        self._constants = np.array([known[robot.servos[servo].name] for servo in servos])
        chosen = [names[servo] for servo in servos]
        self.keys = [
            *(words.current_key(name) for name in chosen),
            *(words.angle_key(name, "Actuator") for name in chosen),
        ]
        """ALMemory keys: first the currents, then the commanded angles, of all servos with a known torque
        constant [N m/A]."""

    def torque(self, values: Sequence[Any], position: Array) -> Array:
        """Returns the torques (n,) [N m] of all servos.

        `values` are the values that ALMemory has for the attribute `keys`: first motor currents [A], then
        commanded angles [rad]. `position` (n,) [rad] are the measured angles. The torque of a servo is NaN if
        the servo's constant [N m/A] is unknown, or if one of the servo's values is not a number.
        """
        numbers = [value if isinstance(value, int | float) else np.nan for value in values]
        amperes, wanted = np.array(numbers, dtype=float).reshape(2, -1)
        torque = np.full(self._count, np.nan)
        torque[self._servos] = self._constants * np.abs(amperes) * np.sign(wanted - position[self._servos])
        return read_only(torque)
