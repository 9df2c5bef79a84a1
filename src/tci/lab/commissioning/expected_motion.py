"""Predicts the visible motion of a servo from the description, as text for the operator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.messages.frames import Array, read_only
from tci.robot.description import Robot, Servo
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain

VISIBLE = 5e-4
"""Least displacement [m] of a link that the operator can see. If the displacement is at least this, the
program tells the operator where the link will go, otherwise how the link will turn. Assumed: smaller
displacements are hardly visible."""
_WAYS = (("forward", "backward"), ("left", "right"), ("up", "down"))
_TURNS = (
    ("its top goes to the right", "its top goes to the left"),
    ("its top goes forward", "its top goes backward"),
    ("its front goes to the left", "its front goes to the right"),
)
"""Words for a positive and a negative rotation about each axis of the torso frame: x (forward), y (left), z
(up)."""


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedMotion:
    """A small motion of one link, in the torso frame."""

    link: str
    """Name of the link to watch."""
    displacement: Array
    """Displacement (3,) [m] of the link's origin."""
    rotation: Array
    """Rotation vector (3,) [rad] of the link."""
    words: str
    """Description of the motion as text for the operator."""


def expected_motion(
    robot: Robot, kinematics: KinematicChain, position: Array, servo: Servo, change: float
) -> ExpectedMotion | None:
    """Predicts the motion of a link if `servo` turns by `change` [rad] while the other servos keep the angles
    `position` (n,) [rad].

    Returns None for a servo that moves no link of the model.
    """
    moved = [link for link in kinematics.links if servo.index in kinematics.chain(link)]
    if not moved:
        return None
    link = max(moved, key=lambda name: len(kinematics.chain(name)))
    column = kinematics.jacobian(position, link)[:, servo.index] * change
    displacement, rotation = column[:3], column[3:]
    if np.linalg.norm(displacement) > VISIBLE:
        ways = [
            f"{1e3 * abs(value):.1f} mm {_WAYS[axis][int(value < 0.0)]}"
            for axis, value in sorted(enumerate(displacement), key=lambda item: -abs(item[1]))
            if abs(value) > 0.3 * np.abs(displacement).max()
        ]
        words = f"{link} moves {' and '.join(ways)}"
    else:
        axis = int(np.argmax(np.abs(rotation)))
        words = f"{link} turns: {_TURNS[axis][int(rotation[axis] < 0.0)]}"
    generic = _generic(robot, position, servo, change)
    return ExpectedMotion(
        link, read_only(displacement), read_only(rotation), words + (f" ({generic})" if generic else "")
    )


def _generic(robot: Robot, position: Array, servo: Servo, change: float) -> str:
    """Returns as text the motion of a generic joint if the servo moves by `change` [rad]: the joint's name
    and the change of its angle. The text is empty if the servo moves no generic joint."""
    after = np.array(position)
    after[servo.index] += change
    for part in robot.parts:
        joints = joint_map(robot, part.name)
        difference = joints.to_generic(after) - joints.to_generic(position)
        place = int(np.argmax(np.abs(difference))) if difference.size else 0
        if difference.size and abs(difference[place]) > 0.1 * abs(change):
            return f"{part.name} {part.servos[place].name} {np.rad2deg(difference[place]):+.1f} degrees"
    return ""
