"""Finds the one arm of a robot that is no humanoid: on a table, a wall, a ceiling or a mobile base.

Its first joint turns the whole arm (the pan), the second lifts it. A third may turn the upper arm about its
length; then comes the elbow. The pan's axis tells how the arm is mounted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_limbs import FoundLimbs, extent_of, median_chain
from tci.lab.authoring.joint_tree import Joint, ancestors, carried, read_joints
from tci.lab.authoring.limb import LEVEL, NOWHERE, Limb, limb_at, second_segment, two_joint_limb_at
from tci.lab.authoring.limb_kind import is_named_as, named_as
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.sleeves import COVER
from tci.messages.frames import Array
from tci.robot.description import Model, Mount
from tci.robot.generic_arm import Side
from tci.robot.kinematics import bare_model
from tci.robot.mounting import OUTWARD
from tci.robot.shoulder import SLANT, nearest_point
from tci.support.engine import mujoco

FORWARD = ("x", "y", "-x", "-y", "z", "-z")
"""Names of the axes of the model's root that may point forward; on a wall, up."""
UPRIGHT = 0.9
"""Least cosine between the pan's axis and the model's z axis at which nobody need say that the arm is on a
table."""
FLAT = 0.02
"""Height of the shoulder above its base, as a fraction of the upper arm's length, below which it does not
tell on which side of the base the arm is. Assumed: larger than errors of CAD models."""


def find_arm(
    model: Model, points: LinkPoints, *, side: Side = "left", mount: Mount | None = None,
    forward: str | None = None, first: str | None = None,
) -> FoundLimbs:  # fmt: skip
    """Finds the arm of a model that has one arm.

    Args:
        model: The kinematic model.
        points: Geometry and masses of its links.
        side: Side as which the arm counts: generic angles of left and right arms are mirror images.
        mount: What the arm stands on, sticks out of or hangs from; None: a table or a ceiling, if its pan's
            axis is upright in the model.
        forward: Axis of the model's root that points forward (on a wall: up), one of `FORWARD`; None: the
            axis along which the arm stretches with the pan at zero, x before y.
        first: Name of the arm's first joint, if the model has several arms.

    Raises DescriptionError if there is no such arm, or more than one and no `first`.
    """
    compiled = bare_model(model)
    data = mujoco.MjData(compiled)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(compiled, data)
    in_root = read_joints(compiled, data, np.eye(3))
    limb = _only(model, in_root, first)
    torso = int(compiled.body_parentid[compiled.body(in_root[limb.ball[0]].link).id])
    outward = _outward(in_root, limb, data.xpos[torso])
    if mount is None and abs(outward[2]) < UPRIGHT:
        message = (
            f"one arm only, at {in_root[limb.ball[0]].name}; valid: a robot with two arms, each the mirror "
            f"image of the other; or --mount {', '.join(get_args(Mount))} for an arm that stands alone"
        )
        raise DescriptionError(model.path, [Fault(0, message)])
    _check_carriers(model, in_root, limb)
    mount = mount or ("table" if outward[2] > 0.0 else "ceiling")
    R_RH = _frame(model, in_root, limb, outward, mount, forward)
    joints = read_joints(compiled, data, R_RH)
    found = limb_at(joints, limb.bend) if len(limb.ball) > 2 else two_joint_limb_at(joints, limb.bend)
    assert found is not None  # as in the root's frame
    limb = _with_end(model, joints, found, points, R_RH)
    if not torso:
        message = (
            f"the arm at {joints[limb.ball[0]].name} starts at the world, which is no link; valid: a "
            "link that carries it, such as one <body name='base'> around the others of an MJCF"
        )
        raise DescriptionError(model.path, [Fault(0, message)])
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[torso].reshape(3, 3).T @ R_RH
    used = {*carried(joints, limb.ball[0]), *ancestors(joints, limb.ball[0])}
    above = float(limb.centre[2]) - 0.1 * extent_of(joints)
    head = median_chain(joints, (), used, above=above) if mount == "table" else ()
    return FoundLimbs(
        joints=joints,
        arms={side: limb},
        legs={},
        torso_link=compiled.body(torso).name,
        trunk=(),
        trunk_below=False,
        head=tuple(one for one in head if is_named_as("head", joints[one].name)),
        devices=(),
        R_RH=R_RH,
        T_ET=pose,
        outward=R_RH.T @ outward,
        mounted=_mounted(compiled, joints[limb.ball[0]].link, torso, points, R_RH, mount),
    )


def _mounted(
    compiled: mujoco.MjModel, arm: str, torso: int, points: LinkPoints, R_RH: Array, mount: Mount
) -> tuple[Mount, float] | None:
    """What carries the arm that begins at the link `arm`, and where: behind all shapes of its base. None if
    the base moves, or other joints of the model don't belong to the arm: then its base is a robot."""
    moved = {compiled.body(arm).id}
    for body in range(1, compiled.nbody):
        if int(compiled.body_parentid[body]) in moved:
            moved.add(body)
    if compiled.body_weldid[torso] or not set(compiled.jnt_bodyid.tolist()) <= moved:
        return None
    fixed = [compiled.body(one).name for one in range(1, compiled.nbody) if not compiled.body_weldid[one]]
    begin = points.link_pose(compiled.body(torso).name)[1]
    heights = (points.of(fixed) - begin) @ R_RH @ OUTWARD[mount]
    return mount, float(heights.min(initial=0.0)) * float(OUTWARD[mount].sum())


def _only(model: Model, joints: Sequence[Joint], first: str | None) -> Limb:
    """The arm of a model, of which no other arm is a part."""
    arms = _limbs(joints)
    names = [joints[limb.ball[0]].name for limb in arms]
    if first is not None:
        arms = [limb for limb, name in zip(arms, names, strict=True) if name == first]
    if len(arms) == 1:
        return arms[0]
    if first is not None:
        message = f"no arm starts at the joint {first}; valid: {' or '.join(names) or 'none in this model'}"
    elif len(shoulders := _shoulders(joints)) == 2:
        message = (
            f"two arms whose shoulders turn in another order, {' and '.join(shoulders)}: neither a shoulder "
            "of three joints of which the last turns the upper arm about its length, nor a pan and a lift; "
            "valid: a robot with one of these shoulders (no option changes the order of its joints)"
        )
    elif len(names) == 2:
        message = (
            f"two limbs, at {' and '.join(names)}, that are no arms of a humanoid: of their shoulders three "
            "joints form no ball, or they are no mirror images; valid: --arms with one of these joints, to "
            "describe this arm alone, and --mount with what it sticks out of if its pan is not upright"
        )
    elif not names and (jaws := _jaws(model, joints)):
        message = (
            f"{jaws}: no three follow each other as in an arm, and no two are jaws that move alike; valid: "
            "two jaws on one link with parallel axes, at most 3 joints each, in a model of at most 0.35 m, "
            "the model of the arm that carries them, or a hand of at least three fingers"
        )
    else:
        message = (
            "no mirrored limbs of which three joints form a ball joint and a fourth bends, and no single arm "
            "that a pan turns, a lift raises and an elbow bends; valid: a humanoid whose z or y is up, with "
            "arms of at least 4 joints, or an arm of at least 3 joints whose lift is square to its pan"
        )
    raise DescriptionError(model.path, [Fault(0, message)])


def _limbs(joints: Sequence[Joint]) -> list[Limb]:
    """What bends as an arm, and is no part of another arm."""
    found = []
    for bend in range(len(joints)):
        limb = limb_at(joints, bend)
        if limb is None or abs(joints[limb.ball[0]].axis @ joints[limb.ball[1]].axis) > SLANT:
            limb = two_joint_limb_at(joints, bend)
        if limb is not None:
            found.append(limb)
    bends = {limb.bend for limb in found}
    return [limb for limb in found if not bends & set(ancestors(joints, limb.bend)[1:])]


def _shoulders(joints: Sequence[Joint]) -> list[str]:
    """The joints of each shoulder that has others before what bends as a pan, a lift and an elbow. Joints
    that carry both arms are no shoulder's."""
    limbs = [limb for bend in range(len(joints)) if (limb := two_joint_limb_at(joints, bend)) is not None]
    limbs = [limb for limb in limbs if named_as(joints, {"left": limb}) != "leg"]
    lines = [ancestors(joints, limb.ball[0]) for limb in limbs]
    found = []
    for limb, line in zip(limbs, lines, strict=True):
        shared = {joint for other in lines if other is not line for joint in other}
        own = [joint for joint in line[::-1] if joint not in shared]
        if len(own) > 1:
            found.append(", ".join(joints[joint].name for joint in (*own, limb.ball[1])))
    return found


def _jaws(model: Model, joints: Sequence[Joint]) -> str:
    """The joints of a model in which no three turning joints follow each other; empty for others."""
    if any(len(ancestors(joints, one)) > 2 for one in range(len(joints))):
        return ""
    compiled = bare_model(model)
    return ", ".join(compiled.joint(joint).name for joint in range(compiled.njnt))


def _check_carriers(model: Model, joints: Sequence[Joint], limb: Limb) -> None:
    """Raises DescriptionError if joints carry the arm that are not parallel to its pan: then the real pan is
    another one."""
    if others := _carriers(joints, limb):
        message = (
            f"what bends as an arm at {joints[limb.ball[0]].name} is carried by {others}, not parallel to "
            "that joint; valid: an arm whose first joint is its pan, and whose second, square to the first, "
            "is its lift"
        )
        raise DescriptionError(model.path, [Fault(0, message)])


def _carriers(joints: Sequence[Joint], limb: Limb) -> str:
    """Names of the joints that carry an arm and are not parallel to its pan. Those that carry a second arm
    are a waist's."""
    pan, *carriers = ancestors(joints, limb.ball[0])
    waist = {
        one for other in _limbs(joints) if other.ball[0] != pan for one in ancestors(joints, other.ball[0])
    }
    others = [
        joints[one].name
        for one in carriers
        if one not in waist and abs(joints[one].axis @ joints[pan].axis) < LEVEL
    ]
    return ", ".join(others[::-1])


def _outward(joints: Sequence[Joint], limb: Limb, base: Array) -> Array:
    """Unit vector (3,) along the pan's axis, away from what the arm is mounted on: from the origin `base`
    (3,) [m] of the link that carries it to its shoulder, or up if both are at one height."""
    axis = joints[limb.ball[0]].axis
    height = float(axis @ (limb.centre - base))
    if abs(height) < FLAT * limb.length:
        height = float(axis[2])
    return axis * (1.0 if height >= 0.0 else -1.0)


def _frame(
    model: Model, joints: Sequence[Joint], limb: Limb, outward: Array, mount: Mount, forward: str | None
) -> Array:
    """Rotation (3, 3) of the frame H (x forward, y left, z up) in the root's frame."""
    axes = {name: (-1.0 if name[0] == "-" else 1.0) * np.eye(3)["xyz".index(name[-1])] for name in FORWARD}
    level = {name: axis for name, axis in axes.items() if abs(axis @ outward) < 0.5}
    if forward is None:
        lift = joints[limb.ball[1]].axis
        along = np.cross(lift, outward)
        tip = max((joints[one].anchor for one in carried(joints, limb.bend)), key=lambda p: abs(along @ p))
        best = max(abs(axis @ along) for axis in level.values())
        able = [name for name, axis in level.items() if abs(axis @ along) > 0.99 * best]
        plain = [name for name in able if name in ("x", "z")]
        forward = plain[0] if plain else max(able, key=lambda name: float(axes[name] @ (tip - limb.centre)))
    elif forward not in level:
        message = f"--forward {forward} is along the pan's axis; valid: {', '.join(level)}"
        raise DescriptionError(model.path, [Fault(0, message)])
    ahead = level[forward] - outward * float(outward @ level[forward])
    ahead /= np.linalg.norm(ahead)
    x, z = {"table": (ahead, outward), "ceiling": (ahead, -outward), "wall": (outward, ahead)}[mount]
    return np.column_stack([x, np.cross(z, x), z])


def _with_end(model: Model, joints: Sequence[Joint], limb: Limb, points: LinkPoints, R_RH: Array) -> Limb:
    """The arm with the end of its forearm, and with its segments beside the pan's axis where their shapes
    are."""
    turn, wrist = second_segment(joints, limb.bend, limb.middle, limb.length, aside=True)
    limb = replace(limb, turn=turn, wrist=wrist)
    if limb.ends_nowhere:
        link = joints[limb.bend if limb.turn is None else limb.turn].link
        end = points.far_end(link, R_RH @ limb.middle)
        limb = limb if end is None else replace(limb, wrist=end @ R_RH)
    if limb.ends_nowhere:
        message = (
            f"nothing after {joints[limb.bend].name} shows where the forearm ends; valid: a joint or a "
            "fixed link at the wrist, or shapes on the forearm"
        )
        raise DescriptionError(model.path, [Fault(0, message)])
    if len(limb.ball) > 2:  # the upper arm begins at the lift, also if the pan's axis is elsewhere
        lift, third = (joints[one] for one in limb.ball[1:])
        return replace(limb, centre=nearest_point(third.anchor, lift.anchor, third.axis, lift.axis))
    axis = joints[limb.bend].axis
    fore = limb.wrist - limb.middle
    if limb.turn is None:
        limb = replace(limb, wrist=limb.wrist - axis * float(axis @ fore))
    spans = {
        "upper_arm": (joints[limb.ball[-1]].link, limb.centre, limb.middle),
        "forearm": (joints[limb.bend].link, limb.middle, limb.wrist),
    }
    aside = {name: _beside(points, R_RH, axis, COVER[name], *span) for name, span in spans.items()}
    fore_aside = aside["forearm"] if limb.turn is None else NOWHERE  # else the turn's axis tells where it is
    return replace(limb, beside=(aside["upper_arm"], fore_aside))


def _beside(
    points: LinkPoints,
    R_RH: Array,
    axis: Array,
    cover: tuple[float, float],
    link: str,
    begin: Array,
    end: Array,
) -> Array:
    """Way (3,) [m] from a segment's line to the middle of the shapes of its link, along `axis` and square to
    it."""
    if points.shapeless:
        return NOWHERE
    shapes = points.of([link]) @ R_RH - begin
    line = (end - begin) / np.linalg.norm(end - begin)
    along = shapes @ (end - begin) / float((end - begin) @ (end - begin))
    near = shapes[(along > cover[0]) & (along < cover[1])]
    if not len(near):
        return NOWHERE
    square = np.column_stack([axis, np.cross(line, axis)])
    off = near @ square
    return np.asarray(square @ (off.min(axis=0) + off.max(axis=0)) / 2.0)
