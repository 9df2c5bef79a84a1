"""The kinematic tree as plain numbers: the parent, pose, joint and inertia of each link.

Exports for other libraries are made from this tree: URDF for Pinocchio, chains for OROCOS KDL.
"""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array, transform
from tci.robot.description import Description, Robot, Vector
from tci.robot.kinematics import at_zero, bare_model, joints_of
from tci.robot.model_file import load_spec
from tci.support.engine import mujoco

Matrix = tuple[tuple[float, ...], ...]
"""A matrix as a tuple of rows."""


class Inertia(Description):
    """Mass, centre of mass and inertia tensor of a link."""

    mass: float
    """Mass [kg]."""
    centre: Vector
    """Centre of mass [m], in the frame of the link."""
    tensor: Matrix
    """Inertia tensor (3, 3) [kg m2] about the centre of mass, in the directions of the link's axes."""


class KinematicLink(Description):
    """One link of the kinematic tree, and the joint that moves the link."""

    name: str
    parent: str
    """Name of the parent, which is the link that carries this link. The name is empty for the root."""
    pose: Matrix
    """`T_PL` (4, 4): pose of the link in the frame of its parent, with all joints at zero."""
    servo: int | None
    """Index in `Robot.servos` of the servo that moves the link relative to its parent, or None if the link is
    fixed."""
    slides: bool = False
    """True if the joint between parent and link is prismatic: it moves the link along `axis` [m]. False if
    the joint is revolute."""
    axis: Vector = (0.0, 0.0, 0.0)
    """Unit vector of the joint's axis, in the frame of the link."""
    anchor: Vector = (0.0, 0.0, 0.0)
    """A point (3,) [m] on the joint's axis, in the frame of the link."""
    inertia: Inertia | None
    """Inertia of the link, or None if the model has no inertia for the link."""


def links_of(robot: Robot) -> tuple[KinematicLink, ...]:
    """Returns all links, each after its parent. Joints without a servo are fixed at zero.

    If a link has several joints, this function adds links without inertia, so that each link has one joint.
    The name of an added link consists of the names of the link and the joint. Raises DescriptionError if the
    robot has no model, or the model lacks a joint.
    """
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, "no <model>: links need a URDF or MJCF file")])
    model = bare_model(robot.model)
    spec = load_spec(robot.model)  # its elements must not outlive it
    heavy = {body.name for body in spec.bodies if body.explicitinertial}
    servos, _, columns = joints_of(robot, model)
    servo_of = {int(model.dof_jntid[column]): servo for servo, column in zip(servos, columns, strict=True)}
    links = []
    for body in range(1, model.nbody):
        name, above = str(model.body(body).name), int(model.body_parentid[body])
        parent = str(model.body(above).name) if above else ""
        inertia = _inertia(model, body) if name in heavy else None
        pose = transform(_rotation(model.body_quat[body]), model.body_pos[body])
        first = int(model.body_jntadr[body])
        moving = [joint for joint in range(first, first + int(model.body_jntnum[body])) if joint in servo_of]
        if not moving:
            links.append(
                KinematicLink(name=name, parent=parent, pose=rows(pose), servo=None, inertia=inertia)
            )
        for joint in moving:
            last = joint == moving[-1]
            own = name if last else f"{name}_{model.joint(joint).name}"
            links.append(
                KinematicLink(
                    name=own,
                    parent=parent,
                    pose=rows(pose @ at_zero(model, joint)),
                    servo=servo_of[joint],
                    slides=bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE),
                    axis=vector(model.jnt_axis[joint]),
                    anchor=vector(model.jnt_pos[joint]),
                    inertia=inertia if last else None,
                )
            )
            parent, pose = own, np.eye(4)
    return tuple(links)


def _inertia(model: mujoco.MjModel, body: int) -> Inertia:
    R = _rotation(model.body_iquat[body])
    return Inertia(
        mass=float(model.body_mass[body]),
        centre=vector(model.body_ipos[body]),
        tensor=rows(R @ np.diag(model.body_inertia[body]) @ R.T),
    )


def _rotation(quaternion: Array) -> Array:
    """Returns the rotation matrix (3, 3) of a unit quaternion (4,) with the real part first."""
    result = np.zeros(9)
    mujoco.mju_quat2Mat(result, quaternion)
    return result.reshape(3, 3)


def rows(matrix: Array) -> Matrix:
    """Converts a matrix to tuples of floats."""
    return tuple(tuple(float(value) for value in row) for row in matrix)


def vector(values: Array) -> Vector:
    """Converts three numbers to a tuple of floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z
