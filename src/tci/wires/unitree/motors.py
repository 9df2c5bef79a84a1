"""Motors of a G1: their slots in the robot's messages, their gains, and the slots that are empty in some
variants."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.robot.tactile_devices import hand_joints
from tci.shared.inspire_dds import DEVICE

if TYPE_CHECKING:
    from tci.robot.description import Robot

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = (
    "shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw"
)  # fmt: skip
NAMES = (
    *(f"{side}_{joint}_joint" for side in ("left", "right") for joint in _LEG),
    *(f"waist_{axis}_joint" for axis in ("yaw", "roll", "pitch")),
    *(f"{side}_{joint}_joint" for side in ("left", "right") for joint in _ARM),
)
"""Usual joint name of each motor, in the order of the slots."""
MOTORS = len(NAMES)
SIDES = ("left", "right")
FINGER_MOTORS = tuple(f"{finger}_{joint}" for finger, joints in (("thumb", 3), ("middle", 2), ("index", 2))
                      for joint in range(joints))  # fmt: skip
"""Motors of a Dex3 hand. In this order of the vendor, the middle finger is before the index finger on both
hands. Other sources have the opposite order on the right hand. Therefore `tci check --hardware` moves each
motor and asks the operator which finger moved."""
INSPIRE = {joint.model: joint.name for joint in hand_joints(DEVICE)}
"""Joints of an Inspire hand, by their usual names behind the side, in the order of its messages."""
FINGER_GAINS = np.array([1.5, 0.1])
"""Gains (2,) of a finger's motor for full stiffness [N m/rad] and full damping [N m s/rad], from the vendor's
example."""
UPPER = range(12, MOTORS)
"""Slots of the motors of waist and arms in the robot's messages. Commands over rt/arm_sdk move these motors.
"""
VARIANTS: dict[int, tuple[int, tuple[int, ...]]] = {
    4: (23, (13, 14, 20, 21, 27, 28)),
    5: (29, ()),
    6: (27, (13, 14)),
}
"""Number of motors, and slots without a motor, for each value of `mode_machine` (variant of the robot)."""
GAINS = np.dtype([("kp", float), ("kd", float)])
"""Full stiffness [N m/rad] and full damping [N m s/rad] of a motor."""
SENT = ("q", "dq", "tau", "kp", "kd")
TARGET = np.dtype([(name, float) for name in (*SENT, "holds")])
"""What a motor should do: angle [rad], velocity [rad/s], torque [N m], stiffness and damping; and the torque
[N m] that holds its links' weight, which is sent in addition. With the vendor's gains alone arms hang up to 7
degrees too low."""
ALL_GAINS = np.array([
    *[(60, 1), (60, 1), (60, 1), (100, 2), (40, 1), (40, 1)] * 2, (60, 1), (40, 1), (40, 1), *[(40, 1)] * 14,
], GAINS)  # fmt: skip
"""Gains (29,) over rt/lowcmd, from the vendor's example."""
ARM_GAINS = np.array([(60.0, 1.5)] * MOTORS, GAINS)
"""Gains (29,) over the topic rt/arm_sdk, from the vendor's example."""


def hand_motor(robot: Robot, servo: str) -> tuple[str, int] | None:
    """Returns hand and motor number of a finger's servo, or None if the servo does not belong to a finger.

    The motor is found by the servo's address in the binding or, without an address, by the servo's name.
    """
    found = re.fullmatch(r"(left|right)_hand_(\w+)_joint", servo)
    usual = f"{found[1]}:{FINGER_MOTORS.index(found[2])}" if found and found[2] in FINGER_MOTORS else ""
    to = re.fullmatch(r"(left|right):([0-6])", robot.binding("unitree").address(servo, usual))
    return None if to is None else (to[1], int(to[2]))


def inspire_joint(robot: Robot, servo: str) -> tuple[str, str] | None:
    """Hand and joint, such as left and thumb_bend, of a servo of an Inspire hand; None of any other servo.

    The joint is found by the servo's address in the binding or, without an address, by the servo's name.
    """
    side, _, name = servo.partition("_")
    usual = f"{side}:{INSPIRE[name]}" if name in INSPIRE else ""
    to = re.fullmatch(r"(left|right):([a-z_]+)", robot.binding("unitree").address(servo, usual))
    return (to[1], to[2]) if to is not None and to[2] in INSPIRE.values() else None


def gains(*, whole: bool) -> NDArray[np.void]:
    """`whole` is True for control over rt/lowcmd, False over rt/arm_sdk."""
    return ALL_GAINS if whole else ARM_GAINS


def commanded(*, whole: bool) -> NDArray[np.intp]:
    """Returns the slots that receive commands: all slots if `whole` is True, otherwise the slots of waist and
    arms."""
    return np.arange(0 if whole else UPPER.start, MOTORS)


def absent(mode_machine: int, *, simulation: bool = False) -> tuple[int, ...]:
    """Returns the slots in the robot's messages that have no motor in the variant `mode_machine` of the G1.
    With `simulation`, the variant 0, which simulators send, has all motors. Raises DriverError for an unknown
    variant."""
    if simulation and mode_machine == 0:
        return ()
    if mode_machine not in VARIANTS:
        valid = ", ".join(f"{mode} ({count} motors)" for mode, (count, _) in VARIANTS.items())
        raise DriverError(f"the robot reports mode_machine {mode_machine}; valid: {valid}")
    return VARIANTS[mode_machine][1]
