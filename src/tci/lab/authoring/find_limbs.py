"""Finds a humanoid's arms, legs, trunk and head in its kinematic model.

Limbs are found by the axes and places of their joints. Joint names also help to tell left from right, and
arms from legs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, permutations
from typing import Any

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_legs import Leg, find_legs
from tci.lab.authoring.joint_tree import Joint, ancestors, beside_median, carried, read_joints
from tci.lab.authoring.limb import Limb, limb_at
from tci.lab.authoring.limb_kind import Pair, Vote, hangs_as, is_named_as, is_named_so, listed, named_as
from tci.lab.authoring.link_points import LinkPoints
from tci.messages.frames import Array, rotation_x, rotation_z
from tci.robot.description import Model, Mount
from tci.robot.generic_arm import Side
from tci.robot.kinematics import bare_model
from tci.support.engine import mujoco

MIRRORED = 0.025
"""Largest distance at which two places count as equal: a left limb and the mirror image of the right limb, or
a neck's axis and the median plane. The distance is a fraction of the extent of all joints. Assumed: larger
than asymmetries of CAD models, smaller than the length of a limb."""

ENDLESS = 720.0
"""Range [rad] above which a joint counts as one without a range; below it may be written in degrees."""
SPINS = re.compile(r"(?i)lidar|laser|hokuyo|velodyne|ouster|livox|spin|scan|rotor|wheel|prop")


class NoPairError(DescriptionError):
    """No limb of a model is the mirror image of another: it may still have one arm."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundLimbs:
    """Limbs, trunk and head found in a model."""

    joints: tuple[Joint, ...]
    arms: dict[str, Limb]
    """Arms by side."""
    legs: dict[Side, Leg]
    """Legs by side; empty for a robot without legs."""
    torso_link: str
    """The link that carries both arms."""
    trunk: tuple[int, ...]
    """Joints between the base and the torso. The joint nearest to the torso is first."""
    trunk_below: bool
    """True if the model's tree leads from the torso over the trunk's joints to the legs, as in a model whose
    root is its torso."""
    head: tuple[int, ...]
    """Joints from the torso to the head."""
    devices: tuple[int, ...]
    """Joints that turn without end where the head's joints are, such as the spindle of a laser."""
    R_RH: Array
    """Rotation (3, 3) of the frame H (x forward, y left, z up) in the model's root frame R."""
    T_ET: Array
    """Pose (4, 4) [m] of the torso frame T in the frame E of `torso_link`."""
    outward: Array | None = None
    """Unit vector (3,) in the frame H along the pan of an arm that stands alone, away from what carries it;
    None for a humanoid."""
    mounted: tuple[Mount, float] | None = None
    """What carries an arm that stands alone, and the place [m] of its surface (`Model.stands_at`); None for a
    robot's arm."""
    hand: Side | None = None
    """Side of a hand that is alone: all joints are its fingers'."""

    @property
    def is_humanoid(self) -> bool:
        """True for a body with two arms."""
        return len(self.arms) == 2

    def behind(self, joint: int) -> list[int]:
        """Returns `joint` and all joints that it carries."""
        return carried(self.joints, joint)


def find_limbs(model: Model, points: LinkPoints, *, arms: tuple[str, str] | None = None) -> FoundLimbs:
    """Finds arms, legs, trunk and head of a model; `points` contains the geometry and masses of the model's
    links.

    Either the z axis or the y axis of the model's root must point up. Joint names that contain a side decide
    between left and right. `arms` are the names of the first joints of the left and the right shoulder;
    without `arms`, places and names decide which limbs are arms. Raises DescriptionError if the model can't
    be read, if it has no two mirrored arms with three joints at the shoulder and one at the elbow, or if arms
    and legs can't be distinguished.
    """
    compiled = bare_model(model)
    data = mujoco.MjData(compiled)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(compiled, data)
    ways = [
        np.round(up @ rotation_z(yaw))
        for up in (np.eye(3), rotation_x(-np.pi / 2.0))
        for yaw in (0.0, np.pi, np.pi / 2.0, -np.pi / 2.0)
    ]
    seen = [(R_RH, read_joints(compiled, data, R_RH)) for R_RH in ways]
    aside = ((R_RH, joints, median) for R_RH, joints in seen for median in _medians(joints))
    for view in chain(((R_RH, joints, 0.0) for R_RH, joints in seen), aside):
        R_RH, joints, median = view
        centred = _shifted(joints, median)
        pairs = [
            {side: replace(limb, **_points(limb, median)) for side, limb in pair.items()}
            for pair in _mirrored(centred, _all_limbs(centred))
            if is_named_so(joints, pair)
        ]
        if pairs:
            break
    else:
        R_RH, joints = seen[0]
        message = _one_arm(joints, _all_limbs(joints)) or (
            "no mirrored limbs of which three joints form a ball joint and a fourth bends; valid: a humanoid "
            "whose z or y is up, with arms of at least 4 joints"
        )
        raise NoPairError(model.path, [Fault(0, message)])
    lone = [
        limb
        for limb in _all_limbs(centred)
        if not any(limb.bend == one.bend for pair in pairs for one in pair.values())
    ]
    found = _arms_of(model, joints, pairs, points, R_RH, chosen=arms, lone=lone)
    lines = [ancestors(joints, limb.ball[0])[1:] for limb in found.values()]
    trunk = tuple(joint for joint in lines[0] if joint in lines[1])
    own = {joint for limb in found.values() for joint in _own_line(joints, limb, trunk)}
    legs = find_legs(centred, {*trunk, *own}, extent_of(joints))
    links = [compiled.body(joints[limb.ball[0]].link).id for limb in found.values()]
    torso = _shared_link(compiled, links, model.path)
    pose = np.eye(4)
    R_EH = data.xmat[compiled.body(torso).id].reshape(3, 3).T @ R_RH
    pose[:3, :3] = R_EH
    if median:
        pose[:3, 3] = R_EH[:, 1] * (median - float(R_RH[:, 1] @ data.xpos[compiled.body(torso).id]))
    used = {*own, *(joint for leg in legs.values() for joint in carried(joints, leg.chain[0]))}
    shoulder = min(float(limb.centre[2]) for limb in found.values())
    above = shoulder - 0.1 * extent_of(joints)
    devices = _devices(compiled, joints, found, {*trunk, *used})
    spun = {one for device in devices for one in carried(joints, device)}
    head = median_chain(centred, trunk, {*used, *spun}, above=above)
    below = False
    if not trunk and legs:
        lines = [ancestors(joints, leg.chain[0])[1:] for leg in legs.values()]
        trunk = tuple(joint for joint in lines[0] if joint in lines[1])[::-1]
        below = bool(trunk)
    return FoundLimbs(
        joints=joints,
        arms=found,
        legs=legs,
        torso_link=torso,
        trunk=trunk,
        trunk_below=below,
        head=head,
        devices=devices,
        R_RH=R_RH,
        T_ET=pose,
    )


def _arms_of(
    model: Model, joints: Sequence[Joint], pairs: Sequence[Pair], points: LinkPoints, R_RH: Array, *,
    chosen: tuple[str, str] | None, lone: Sequence[Limb],
) -> dict[str, Limb]:  # fmt: skip
    """Returns the two limbs of `pairs` that are the arms, by side, each with the end of its forearm. `chosen`
    are the names of their first joints, if the user gave these names; `lone` are limbs without a mirror
    image.

    Raises DescriptionError if not exactly one pair of limbs can be the arms, or if nothing shows the end of a
    forearm.
    """
    if chosen is not None:
        own = [
            pair
            for pair in pairs
            if chosen == tuple(joints[pair[side].ball[0]].name for side in ("left", "right"))
        ]
        if not own:
            others = [pair for pair in pairs if _kind(joints, pair, points, R_RH) != "leg"]
            valid = f"valid: {listed(joints, others)}" if others else _one_arm(joints, lone)
            valid = valid or "no limbs of the model bend as two arms do; valid: a robot with two arms"
            message = f"no arms start at the joints {','.join(chosen)}; {valid}"
            raise DescriptionError(model.path, [Fault(0, message)])
    else:
        votes = [_kind(joints, pair, points, R_RH) for pair in pairs]
        own = [pair for pair, kind in zip(pairs, votes, strict=True) if kind == "arm"]
        doubtful = [pair for pair, kind in zip(pairs, votes, strict=True) if kind is None]
        if len(own) != 1 or doubtful:
            which = listed(joints, own or pairs)
            message = (
                f"{which} may be arms or legs; valid: --arms LEFT,RIGHT with the first joint of each shoulder"
            )
            if not doubtful and not own and (lonely := _one_arm(joints, lone)):
                message = lonely
            elif not doubtful and not own:
                message = (
                    f"both limbs at {which} are legs, and no others bend as an arm does; valid: arms of "
                    "three joints at the shoulder, the last along the upper arm, and one at the elbow; or "
                    "--arms LEFT,RIGHT if these are the arms"
                )
            raise DescriptionError(model.path, [Fault(0, message)])
    return {side: _ended(model, joints, side, own[0][side], points, R_RH) for side in ("left", "right")}


def _one_arm(joints: Sequence[Joint], lone: Sequence[Limb]) -> str:
    """The message about limbs without a mirror image that are named as arms; empty if there are none."""
    single = [joints[limb.ball[0]].name for limb in lone if named_as(joints, {"left": limb}) == "arm"]
    if not single:
        return ""
    return (
        f"one arm only, at {', '.join(single)}; valid: a robot with two arms, each the mirror image of the "
        "other"
    )


def _kind(joints: Sequence[Joint], pair: Pair, points: LinkPoints, R_RH: Array) -> Vote:
    """Returns "arm" or "leg" for a pair of limbs, from their place and their names. Returns None if place and
    names contradict each other, or if neither place nor names determine the kind.
    """
    moved = [joints[limb.ball[0]].link for limb in pair.values()]
    centre = points.centre_of_mass_without(moved)
    place = hangs_as(pair, None if centre is None else float((centre @ R_RH)[2]))
    named = named_as(joints, pair)
    return place or named if None in (place, named) or place == named else None


def _ended(
    model: Model, joints: Sequence[Joint], side: str, limb: Limb, points: LinkPoints, R_RH: Array
) -> Limb:
    """Returns the limb, with the end of its forearm added if `limb` lacks this end.

    The added end is the origin of a link that is fixed to the forearm, such as a hand, or else the far end of
    the forearm's geometry. Raises DescriptionError if the model contains neither.
    """
    limb = _without_stray_frame(joints, limb, points, R_RH)
    if not limb.ends_nowhere:
        return limb
    link = joints[limb.bend if limb.turn is None else limb.turn].link
    end = points.far_end(link, R_RH @ limb.middle)
    ended = limb if end is None else replace(limb, wrist=end @ R_RH)
    if ended.ends_nowhere:
        message = (
            f"nothing after {joints[limb.bend].name} shows where the {side} forearm ends; valid: a joint or "
            "a fixed link at the wrist, or shapes on the forearm"
        )
        raise DescriptionError(model.path, [Fault(0, message)])
    return ended


def _without_stray_frame(joints: Sequence[Joint], limb: Limb, points: LinkPoints, R_RH: Array) -> Limb:
    """The limb, with its wrist where the forearm's shapes end if only the frame of a turning joint told it,
    and this frame lies on the other side of the elbow or far beyond all shapes. A frame may lie anywhere on
    the axis of its joint: makers of CAD use that."""
    if limb.turn is None or any(other.parent == limb.turn for other in joints):
        return limb
    ends = [
        end @ R_RH - limb.middle
        for link in (joints[limb.bend].link, joints[limb.turn].link)
        if (end := points.far_end(link, R_RH @ limb.middle)) is not None
    ]
    if not ends:
        return limb
    told, length = limb.wrist - limb.middle, float(np.linalg.norm(limb.wrist - limb.middle))
    farthest = max(float(np.linalg.norm(end)) for end in ends)
    if length <= 0.0 or (float(told @ ends[0]) > 0.0 and length <= farthest):
        return limb
    axis = joints[limb.turn].axis
    return replace(limb, wrist=limb.middle + axis * float(axis @ ends[0]))


def _medians(joints: Sequence[Joint]) -> list[float]:
    """Returns possible y coordinates [m] of the median plane, for a model whose root is beside this plane:
    those at which one limb is the mirror image of another.
    """
    tolerance = MIRRORED * extent_of(joints)
    limbs = [limb for bend in range(len(joints)) if (limb := limb_at(joints, bend)) is not None]
    found: list[float] = []
    for left, right in permutations(limbs, 2):
        across = left.centre - right.centre
        median = float(left.centre[1] + right.centre[1]) / 2.0
        alike = across[1] > 2.0 * tolerance and np.hypot(across[0], across[2]) < tolerance
        if alike and all(abs(median - other) > tolerance for other in found):
            found.append(median)
    return found


def _shifted(joints: Sequence[Joint], median: float) -> tuple[Joint, ...]:
    """Returns the joints with their positions relative to the median plane: `median` [m], the y coordinate of
    this plane, is subtracted."""
    away = np.array([0.0, median, 0.0])
    return tuple(replace(joint, anchor=joint.anchor - away) for joint in joints)


def _points(limb: Limb, median: float) -> dict[str, Any]:
    """Returns the points `centre`, `middle` and `wrist` of a limb, by these names, relative to the model's
    root.

    In `limb`, the points are relative to the median plane, which is at y = `median` [m].
    """
    away = np.array([0.0, median, 0.0])
    return {name: getattr(limb, name) + away for name in ("centre", "middle", "wrist")}


def _all_limbs(joints: Sequence[Joint]) -> list[Limb]:
    """Returns the limbs attached to the trunk. Limb-like chains farther out, such as a wrist, are left
    out."""
    shared = {index for index in range(len(joints)) if _carries_both_sides(joints, index)}
    found = []
    for index in range(len(joints)):
        if not shared & set(ancestors(joints, index)[:4]) and (limb := limb_at(joints, index)) is not None:
            found.append(limb)
    bends = {limb.bend for limb in found}
    return [limb for limb in found if not bends & set(ancestors(joints, limb.bend)[1:])]


def extent_of(joints: Sequence[Joint]) -> float:
    """Returns the extent [m] of all joints along the axis with the largest extent.

    A joint that carries no joint, and that no joint carries, is left out: in some models such a joint is a
    placeholder far away.
    """
    parents = {joint.parent for joint in joints}
    chained = [one.anchor for place, one in enumerate(joints) if one.parent >= 0 or place in parents]
    return float(np.ptp(chained or [np.zeros(3)], axis=0).max())


def _carries_both_sides(joints: Sequence[Joint], index: int) -> bool:
    """Returns True if a joint carries joints of the left and of the right side, so that it belongs to the
    trunk."""
    sideways = [joints[other].anchor[1] for other in carried(joints, index)]
    left, right = max(sideways), -min(sideways)
    return bool(
        min(left, right) > MIRRORED * extent_of(joints) and abs(left - right) < 0.2 * max(left, right)
    )


def _mirrored(joints: Sequence[Joint], limbs: list[Limb]) -> list[Mapping[str, Limb]]:
    """Returns pairs of a left and a right limb that are mirror images."""
    mirror, tolerance = np.array([1.0, -1.0, 1.0]), MIRRORED * extent_of(joints)
    pairs: list[Mapping[str, Limb]] = []
    for left in limbs:
        if not left.centre[1] > tolerance:
            continue
        for right in limbs:
            if np.linalg.norm(left.centre * mirror - right.centre) < tolerance:
                pairs.append({"left": left, "right": right})
                break
    return pairs


def _own_line(joints: Sequence[Joint], limb: Limb, trunk: tuple[int, ...]) -> list[int]:
    """Returns all joints that belong to a limb: the limb's own joints, joints farther out, and joints between
    the limb and the trunk."""
    return [*carried(joints, limb.ball[0]), *set(ancestors(joints, limb.ball[0])).difference(trunk)]


def _shared_link(model: mujoco.MjModel, bodies: list[int], path: str) -> str:
    """Returns the name of the nearest link that carries both of two `bodies` (indices in the model). Raises
    DescriptionError if no link but the world carries both."""
    lines = []
    for body in bodies:
        line = []
        while (body := int(model.body_parentid[body])) > 0:
            line.append(body)
        lines.append(line)
    shared = next((body for body in lines[0] if body in lines[1]), 0)
    if not shared:
        message = (
            "both arms start at the world, which is no link; valid: a link that carries both, such as one "
            "<body name='torso'> around all others of an MJCF"
        )
        raise DescriptionError(path, [Fault(0, message)])
    return str(model.body(shared).name)


def _devices(
    model: mujoco.MjModel, joints: Sequence[Joint], arms: Mapping[str, Limb], used: set[int]
) -> tuple[int, ...]:
    """The joints without a range outside `used`, in a model whose elbows have ranges: where a maker tells
    ranges, only a spindle or a wheel turns without end, and no neck does. One that is named as a neck stays,
    unless it is also named as a device."""

    def endless(place: int) -> bool:
        joint = model.joint(joints[place].name)
        return not model.jnt_limited[joint.id] or float(np.abs(joint.range).max()) > ENDLESS

    if any(endless(limb.bend) for limb in arms.values()):
        return ()
    names = [joint.name for joint in joints]
    return tuple(
        place for place, name in enumerate(names)
        if place not in used and endless(place) and (not is_named_as("head", name) or SPINS.search(name))
    )  # fmt: skip


def median_chain(
    joints: Sequence[Joint], trunk: tuple[int, ...], used: set[int], *, above: float
) -> tuple[int, ...]:
    """Returns the joints of the head: the longest chain of joints on the torso that lies in the median plane
    and ends higher than `above` [m]. Joints in `used` are left out."""
    root, tolerance = trunk[0] if trunk else -1, MIRRORED * extent_of(joints)
    best: tuple[int, ...] = ()
    for index, joint in enumerate(joints):
        chain = ancestors(joints, index)
        own = tuple(chain[: chain.index(root)] if root in chain else chain)[::-1]
        middle = all(beside_median(joints[i]) < tolerance for i in own)
        on_torso = root in (*chain, -1) and not used & set(own)
        if own and on_torso and middle and joint.anchor[2] > above and len(own) > len(best):
            best = own
    return best
