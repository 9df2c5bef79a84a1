"""The way to some links, as sums that a compiled loop takes step by step.

A link that hangs on a turning joint at the angle q has the pose K0 + K1 cos q + K2 sin q in the one before,
by Rodrigues' formula R = a a^T + (1 - a a^T) cos q + [a] sin q about the axis a, through a point of it. On
a sliding joint it is K0 + K1 q.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.engine import mujoco
from tci.frames import Array, read_only, transform
from tci.robot.description import Robot
from tci.robot.kinematics import Kinematics, joints_of


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """From the world to some links of a robot, those before others first."""

    steps: NDArray[np.int64]
    """Of each step (s, 3): the step before, -1 for the world; the servo, -1 for none; 1 where it slides."""
    sums: Array
    """K0, K1 and K2 (s, 3, 3, 4) of each: rotation and place [m] side by side."""
    ends: NDArray[np.int64]
    """After which step each link (l,) is."""
    torso: int
    """After which step the frame of the torso is."""


def steps_to(robot: Robot, kinematics: Kinematics, links: Iterable[str]) -> Steps:
    """The steps to `links` and the torso. Joints that are no servo's stay where they are at zero.

    Raises UnknownNameError for a link that the model lacks.
    """
    assert robot.model is not None  # as it has kinematics
    model = kinematics.model
    servos, _, columns = joints_of(robot, model)
    servo_of = {int(model.dof_jntid[column]): servo for servo, column in zip(servos, columns, strict=True)}
    steps: list[tuple[int, int, bool]] = []
    sums: list[Array] = []
    after = {0: -1}

    def add(before: int, servo: int, slides: bool, three: Array) -> int:
        steps.append((before, servo, slides))
        sums.append(three)
        return len(steps) - 1

    def reach(body: int) -> int:
        if body not in after:
            step = reach(int(model.body_parentid[body]))
            step = add(step, -1, False, _fixed(_pose(model, body)))
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])):
                if joint in servo_of:
                    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                    step = add(step, servo_of[joint], slides, _moving(model, joint, slides))
            after[body] = step
        return after[body]

    ends = [reach(kinematics.body(link)) for link in links]
    torso = add(reach(kinematics.body(robot.model.torso_link)), -1, False, _fixed(robot.model.T_LT))
    return Steps(read_only(steps, np.int64), read_only(sums), read_only(ends, np.int64), torso)


def at_zero(model: mujoco.MjModel, joint: int) -> Array:
    """The move (4, 4) of a body by a hinge or slide, in the body's frame, when its angle is 0: none unless
    the model gives it a reference."""
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    still, cos, _ = _moving(model, joint, slides)
    pose = np.eye(4)
    pose[:3] = still if slides else still + cos
    return pose


def _pose(model: mujoco.MjModel, body: int) -> Array:
    """Of a body in the one that carries it, all joints at zero."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_quat[body])
    return transform(rotation.reshape(3, 3), model.body_pos[body])


def _fixed(pose: Array) -> Array:
    return np.stack([pose[:3], np.zeros((3, 4)), np.zeros((3, 4))])


def _moving(model: mujoco.MjModel, joint: int, slides: bool) -> Array:
    a, point, zero = model.jnt_axis[joint], model.jnt_pos[joint], float(model.qpos0[model.jnt_qposadr[joint]])
    if slides:
        way = np.column_stack([np.zeros((3, 3)), a])
        return np.stack([np.eye(3, 4) - zero * way, way, np.zeros((3, 4))])
    along, cross = np.outer(a, a), np.cross(a, np.eye(3)).T
    still, cos, sin = (np.column_stack([R, -R @ point]) for R in (along, np.eye(3) - along, cross))
    still[:, 3] += point
    c, s = np.cos(zero), np.sin(zero)
    return np.stack([still, c * cos - s * sin, s * cos + c * sin])
