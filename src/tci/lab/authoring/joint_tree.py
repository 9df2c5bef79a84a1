"""The revolute joints of a kinematic model as a tree, seen from the model's root."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tci.messages.frames import Array
from tci.support.engine import mujoco


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A revolute joint at the model's zero, in frame H: origin at the model's root, x forward, y left, z
    up."""

    name: str
    link: str
    """Name of the link that the joint moves."""
    parent: int
    """Index of the joint that carries this joint; -1 for none."""
    axis: Array
    """Unit vector (3,) along the joint's axis."""
    anchor: Array
    """A point (3,) [m] on the joint's axis."""


def read_joints(model: mujoco.MjModel, data: mujoco.MjData, R_RH: Array) -> tuple[Joint, ...]:
    """Returns all revolute joints in the frame H (origin at the model's root, x forward, y left, z up). A
    parent precedes its children. `R_RH` is the rotation of H in the root's frame."""
    turning = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    last: dict[int, int] = {0: -1}
    joints: list[Joint] = []
    for body in range(1, model.nbody):
        parent = last[int(model.body_parentid[body])]
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count) if count else ():
            if joint in turning:
                axis, anchor = R_RH.T @ data.xaxis[joint], R_RH.T @ data.xanchor[joint]
                joints.append(Joint(model.joint(joint).name, model.body(body).name, parent, axis, anchor))
                parent = len(joints) - 1
        last[body] = parent
    return tuple(joints)


def ancestors(joints: Sequence[Joint], index: int) -> list[int]:
    """Returns the joint and all joints that carry it, from the joint back to the root."""
    line = []
    while index >= 0:
        line.append(index)
        index = joints[index].parent
    return line


def carried(joints: Sequence[Joint], index: int) -> list[int]:
    """Returns the joint and all joints that it carries."""
    found = {index}
    for other, joint in enumerate(joints):
        if joint.parent in found:
            found.add(other)
    return sorted(found)


def beside_median(joint: Joint) -> float:
    """Returns the distance [m] of a joint's axis from the median plane; 0 for an axis that crosses it."""
    return 0.0 if abs(joint.axis[1]) > 0.5 else abs(float(joint.anchor[1]))
