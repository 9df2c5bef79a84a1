"""NAOqi's service for the usual postures of a NAO, of a robot that TCI serves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import qi

from tci.robot.description import Servo
from tci.wires.naoqi.board import Board

_JOINTS = (
    "HeadYaw", "HeadPitch", "LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw",
    "LHand", "LHipYawPitch", "LHipRoll", "LHipPitch", "LKneePitch", "LAnklePitch", "LAnkleRoll",
)  # fmt: skip
_ANGLES = {
    "Stand": (0, -0.17, 1.443, 0.224, -1.202, -0.417, 0.1, 0.3, -0.17, 0.119, 0.127, -0.092, 0.087, -0.111),
    "StandInit": (0, 0, 1.4, 0.3, -1.39, -1.01, 0, 0.25, 0, 0, -0.45, 0.7, -0.35, 0),
    "StandZero": (0, 0, 0, 0.009, 0, -0.035, 0, 0, 0, 0, 0, 0, 0, 0),
    "Crouch": (0, 0.1, 1.397, 0.16, -0.792, -1.074, 0.15, 0, -0.25, -0.08, -0.7, 2.11, -1.18, 0.077),
    "Sit": (0, 0, 0.91, 0.29, -0.49, -1.21, 0, 0.29, -0.607, 0.266, -1.534, 1.396, 0.843, -0.017),
}
"""Angles [rad] of head and left side, as qiBullet 1.4.6 has them (Busy and Caniot 2019); the right side is
the mirror image, and Sit the mean of both."""
FAMILIES = {"Stand": "Standing", "StandInit": "Standing", "StandZero": "Standing", "Crouch": "Crouching",
            "Sit": "Sitting"}  # fmt: skip
NEAR = 0.2
"""A posture is told if every joint is at most this far [rad] from it. Assumed: more than gravity bends."""


def posture(name: str, servos: list[Servo]) -> dict[str, float]:
    """The angle [rad] of each of a robot's joints in a posture, within its limits. Raises ValueError for an
    unknown posture."""
    if name not in _ANGLES:
        raise ValueError(f"posture {str(name)[:40]!r}; valid: {', '.join(_ANGLES)}")
    angles = dict(zip(_JOINTS, map(float, _ANGLES[name]), strict=True))
    for joint in _JOINTS[2:]:
        angles[f"R{joint[1:]}"] = angles[joint] * (-1.0 if joint.endswith(("Roll", "Yaw")) else 1.0)
    return {
        servo.name: min(max(angles[servo.name], _least(servo)), _most(servo))
        for servo in servos
        if servo.name in angles
    }


def _least(servo: Servo) -> float:
    return 0.0 if servo.limits.lower is None else servo.limits.lower


def _most(servo: Servo) -> float:
    return 1.0 if servo.limits.upper is None else servo.limits.upper


@qi.multiThreaded()
class ALRobotPosture:
    """NAOqi's service for postures. The robot goes there on a straight way, as with `applyPosture`."""

    def __init__(self, board: Board, move: Callable[..., None], stop: Callable[[], None]) -> None:
        """Moves with `move`, as `ALMotion.angleInterpolationWithSpeed`, and stops with `stop`."""
        self._board, self._move, self._stop = board, move, stop
        self._servos = list(board.robot.servos)

    def getPostureList(self) -> list[str]:
        """Returns the postures that this robot can go to."""
        return list(_ANGLES)

    def getPosture(self) -> str:
        """Returns the posture that the robot has, or `Unknown`."""
        here = self._board.measured
        index = {servo.name: servo.index for servo in self._servos}
        off = {
            name: max(abs(here[index[joint]] - angle) for joint, angle in posture(name, self._servos).items())
            for name in _ANGLES
        }
        best = min(off, key=lambda name: off[name])
        return best if off[best] <= NEAR else "Unknown"

    def getPostureFamily(self) -> str:
        """Returns `Standing`, `Crouching`, `Sitting` or `Unknown`."""
        return FAMILIES.get(self.getPosture(), "Unknown")

    @qi.bind(qi.Bool, [qi.String, qi.Float])
    def goToPosture(self, postureName: str, maxSpeedFraction: float) -> bool:
        """Moves all joints to a posture. Returns True when they are there, and False if they can't arrive."""
        angles: dict[str, Any] = posture(postureName, self._servos)
        try:
            self._move([*angles], [*angles.values()], maxSpeedFraction)
        except RuntimeError:
            return False
        return True

    applyPosture = goToPosture

    def stopMove(self) -> None:
        """Stops all joints where they are."""
        self._stop()
