"""Finds a humanoid's arms, legs, trunk and head in its kinematic model, by geometry alone.

A limb consists of three joints that form a ball joint, and a fourth at a distance that bends the limb. The
axis of the fourth is perpendicular to that of the third, which lies along the limb (the generic arm, and a
human leg).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.engine import mujoco
from tci.errors import DescriptionError, Fault
from tci.frames import Array, rotation_x, rotation_z
from tci.robot.description import Model
from tci.robot.kinematics import bare_model
from tci.robot.shoulder import SLANT, nearest_point

PARALLEL = 0.9
"""Cosine above which two successive axes of a ball joint are too close to parallel. Assumed: 26 degrees."""
ASIDE = 0.6
"""Largest distance of a limb's axis from its ball joint, and of its bending axis, as a fraction of its
length. Assumed; larger takes other chains of joints for limbs, smaller misses limbs with offset joints."""
SHORT = 0.18
"""Least length of an upper arm or thigh, as a fraction of the reach of its chain. Assumed; larger misses
short limbs, smaller takes links of a wrist or an ankle for limbs."""
MIRRORED = 0.02
"""Largest distance [m] of a left limb from the mirror image of the right one. Assumed: above asymmetries of
CAD models, below the length of a limb."""


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A revolute joint at the model's zero, in the frame H: at the model's root, x forward, y left, z up."""

    name: str
    link: str
    """Name of the link that it moves."""
    parent: int
    """Index of the previous joint; -1 for none."""
    axis: Array
    """Unit vector (3,) of its axis."""
    anchor: Array
    """A point (3,) [m] on its axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """An arm or a leg, by indices of joints."""

    ball: tuple[int, int, int]
    """Joints of the shoulder or hip, from the trunk outwards."""
    bend: int
    """Joint of the elbow or knee."""
    turn: int | None
    """First joint after `bend` that turns along the limb (pronation); None if there is none."""
    centre: Array
    """Centre (3,) [m] of the ball joint: the point of the third axis nearest to the first two."""
    middle: Array
    """Point (3,) [m] of the third axis that is nearest to the bending axis."""
    wrist: Array
    """End (3,) [m] of the second segment."""

    @property
    def length(self) -> float:
        """Distance [m] from centre to middle."""
        return float(np.linalg.norm(self.middle - self.centre))


@dataclass(frozen=True, slots=True, eq=False)
class FoundLimbs:
    """Limbs, trunk and head found in a model."""

    joints: tuple[Joint, ...]
    arms: dict[str, Limb]
    """Arms by side."""
    legs: dict[str, Limb]
    """Legs by side; empty for a robot without legs."""
    torso_link: str
    """The link that carries both arms."""
    trunk: tuple[int, ...]
    """Joints from the root to the torso."""
    head: tuple[int, ...]
    """Joints from the torso to the head."""
    R_RH: Array
    """Rotation (3, 3) of the frame H in the model's root R."""
    T_ET: Array
    """Pose (4, 4) [m] of the torso frame T in its link E."""

    def behind(self, joint: int) -> list[int]:
        """Returns the joint and all joints that it carries."""
        return _carried(self.joints, joint)


def find_limbs(model: Model) -> FoundLimbs:
    """Finds arms, legs, trunk and head of a model.

    The z axis of its root is up, or else y. Joint names decide between left and right if they tell it. Raises
    DescriptionError for a model without two mirrored arms of the generic kind, and what `load_spec` raises.
    """
    compiled = bare_model(model)
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    ways = [
        np.round(up @ rotation_z(yaw))
        for up in (np.eye(3), rotation_x(-np.pi / 2.0))
        for yaw in (0.0, np.pi, np.pi / 2.0, -np.pi / 2.0)
    ]
    for R_RH in ways:
        joints, moved = _joints(compiled, data, R_RH)
        pairs = [pair for pair in _mirrored(_all_limbs(joints)) if _is_named_so(joints, pair)]
        if pairs:
            break
    else:
        message = "no mirrored limbs with a ball joint and a bend; valid: a humanoid whose z or y is up"
        raise DescriptionError(model.path, [Fault(0, message)])
    pairs.sort(key=lambda pair: -float(pair["left"].centre[2]))
    arms, legs = pairs[0], pairs[-1] if len(pairs) > 1 else {}
    lines = [_ancestors(joints, limb.ball[0])[1:] for limb in arms.values()]
    trunk = tuple(joint for joint in lines[0][::-1] if joint in lines[1])
    torso = _shared_link(compiled, moved, [limb.ball[0] for limb in arms.values()])
    used = {joint for limb in (*arms.values(), *legs.values()) for joint in _ancestors(joints, limb.ball[0])}
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[compiled.body(torso).id].reshape(3, 3).T @ R_RH
    return FoundLimbs(
        joints=tuple(joints),
        arms=arms,
        legs=legs,
        torso_link=torso,
        trunk=trunk,
        head=_head(joints, trunk, used),
        R_RH=R_RH,
        T_ET=pose,
    )


def _all_limbs(joints: list[Joint]) -> list[Limb]:
    """Returns the limbs attached to the trunk, without limb-like chains farther out on them."""
    shared = {index for index in range(len(joints)) if _carries_both_sides(joints, index)}
    found = []
    for index in range(len(joints)):
        if not shared & set(_ancestors(joints, index)[:4]) and (limb := _limb(joints, index)) is not None:
            found.append(limb)
    bends = {limb.bend for limb in found}
    return [limb for limb in found if not bends & set(_ancestors(joints, limb.bend)[1:])]


def _is_named_so(joints: list[Joint], pair: Mapping[str, Limb]) -> bool:
    """True if the joint names do not contradict the sides."""
    return all(_named_side(joints[limb.ball[0]].name) in (None, side) for side, limb in pair.items())


def _named_side(name: str) -> str | None:
    """Returns the side that a joint's name starts with, or names first: `LARM_SHOULDER_R` is on the left.
    None if the name tells no side."""
    found = re.search(r"(?i)(?<![a-z])(left|right|[lr](?=arm|leg|hip|sho|[^a-z]))", name)
    return None if found is None else {"l": "left", "r": "right"}[found[1][0].lower()]


def _joints(model: mujoco.MjModel, data: mujoco.MjData, R_RH: Array) -> tuple[list[Joint], list[int]]:
    """Returns all revolute joints in the frame H, and the MuJoCo body that each moves."""
    turning = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    place = {joint: index for index, joint in enumerate(turning)}
    last: dict[int, int] = {0: -1}
    joints, bodies = [], []
    for body in range(1, model.nbody):
        parent = last[int(model.body_parentid[body])]
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count) if count else ():
            if joint in place:
                axis, anchor = R_RH.T @ data.xaxis[joint], R_RH.T @ data.xanchor[joint]
                joints.append(Joint(model.joint(joint).name, model.body(body).name, parent, axis, anchor))
                bodies.append(body)
                parent = len(joints) - 1
        last[body] = parent
    return joints, bodies


def _carries_both_sides(joints: list[Joint], index: int) -> bool:
    """True if a joint carries joints of both sides, so that it belongs to the trunk."""
    sideways = [joints[other].anchor[1] for other in _carried(joints, index)]
    left, right = max(sideways), -min(sideways)
    return bool(min(left, right) > MIRRORED and abs(left - right) < 0.2 * max(left, right))


def _carried(joints: Sequence[Joint], index: int) -> list[int]:
    """Returns the joint and all joints that it carries. Requires that parents come before their children."""
    found = {index}
    for other, joint in enumerate(joints):
        if joint.parent in found:
            found.add(other)
    return sorted(found)


def _limb(joints: list[Joint], bend: int) -> Limb | None:
    """Returns the limb that bends at a joint; None if there is none."""
    chain = _ancestors(joints, bend)
    if len(chain) < 4:
        return None
    fourth, third, second, first = (joints[index] for index in chain[:4])
    if abs(fourth.axis @ third.axis) > SLANT:
        return None
    if max(abs(first.axis @ second.axis), abs(second.axis @ third.axis)) > PARALLEL:
        return None
    cross = nearest_point(first.anchor, second.anchor, first.axis, second.axis)
    centre = third.anchor + third.axis * float(third.axis @ (cross - third.anchor))
    middle = nearest_point(third.anchor, fourth.anchor, third.axis, fourth.axis)
    length = float(np.linalg.norm(middle - centre))
    across = np.cross(third.axis, fourth.axis)
    away = abs(float((fourth.anchor - third.anchor) @ across) / float(np.linalg.norm(across)))
    reach = _reach(joints, bend, centre)
    if length < SHORT * reach or max(float(np.linalg.norm(cross - centre)), away) > ASIDE * length:
        return None
    turn, wrist = _second_segment(joints, bend, middle)
    ball = (chain[3], chain[2], chain[1])
    return Limb(ball, bend, turn, centre, middle, wrist)


def _second_segment(joints: list[Joint], bend: int, middle: Array) -> tuple[int | None, Array]:
    """Returns the joint that turns along the forearm, if any, and the forearm's end (3,) [m]."""
    after = [index for index, joint in enumerate(joints) if joint.parent == bend]
    for index in after:
        joint = joints[index]
        across = (joint.anchor - middle) - joint.axis * float(joint.axis @ (joint.anchor - middle))
        beyond = [other for other in joints if other.parent == index]
        if abs(joint.axis @ joints[bend].axis) > SLANT or np.linalg.norm(across) > 0.06:
            continue
        ends = [other.anchor for other in beyond] or [joint.anchor]
        along = [joint.axis * float(joint.axis @ (end - middle)) for end in (*ends, joint.anchor)]
        if max(float(np.linalg.norm(step)) for step in along) > 0.05:
            return index, middle + max(along, key=lambda step: float(np.linalg.norm(step)))
    ends = [joints[index].anchor for index in after]
    axis = joints[bend].axis
    level = [end - axis * float(axis @ (end - middle)) for end in ends]
    return None, max(level, key=lambda end: float(np.linalg.norm(end - middle)), default=middle)


def _reach(joints: list[Joint], bend: int, centre: Array) -> float:
    """Returns the largest distance [m] from the ball joint to a joint that the bend carries."""
    return max(float(np.linalg.norm(joints[index].anchor - centre)) for index in _carried(joints, bend))


def _mirrored(limbs: list[Limb]) -> list[dict[str, Limb]]:
    """Returns pairs of a left and a right limb."""
    mirror = np.array([1.0, -1.0, 1.0])
    pairs = []
    for left in limbs:
        if not left.centre[1] > MIRRORED:
            continue
        for right in limbs:
            if np.linalg.norm(left.centre * mirror - right.centre) < MIRRORED:
                pairs.append({"left": left, "right": right})
                break
    return pairs


def _ancestors(joints: list[Joint], index: int) -> list[int]:
    """Returns the joint and those that carry it, up to the root."""
    line = []
    while index >= 0:
        line.append(index)
        index = joints[index].parent
    return line


def _shared_link(model: mujoco.MjModel, bodies: list[int], first: list[int]) -> str:
    """Returns the link that carries both of two joints."""
    lines = []
    for joint in first:
        line, body = [], int(model.body_parentid[bodies[joint]])
        while body > 0:
            line.append(body)
            body = int(model.body_parentid[body])
        lines.append(line)
    return str(model.body(next(body for body in lines[0] if body in lines[1])).name)


def _head(joints: list[Joint], trunk: tuple[int, ...], used: set[int]) -> tuple[int, ...]:
    """Returns the longest chain of joints in the median plane that the trunk carries, above it."""
    root = trunk[-1] if trunk else -1
    best: tuple[int, ...] = ()
    for index, joint in enumerate(joints):
        chain = _ancestors(joints, index)
        own = tuple(chain[: chain.index(root)] if root in chain else chain)[::-1]
        middle = all(abs(joints[i].anchor[1]) < MIRRORED for i in own)
        above = root < 0 or joint.anchor[2] > joints[root].anchor[2]
        carried = root in (*chain, -1) and not used & set(own)
        if own and carried and middle and above and len(own) > len(best):
            best = own
    return best
