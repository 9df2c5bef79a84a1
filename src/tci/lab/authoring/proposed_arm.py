"""Proposes the generic arm: transforms, segments, the direction of the elbow, and an initial posture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.initial_posture import POSTURES, with_initial
from tci.lab.authoring.limb import Limb
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_parts import find_mount, generic_joint, segment
from tci.lab.authoring.sleeves import axes_of, ends_of
from tci.messages.frames import rotation_rpy
from tci.robot.description import GenericPart, GenericServo, Robot, Segment
from tci.robot.generic_arm import JOINTS, Side, side_sign
from tci.robot.joint_map import joint_map
from tci.robot.shoulder import Shoulder, angle_about

Sign = Literal[1, -1]
"""Direction in which a joint turns, about its axis in the model."""

LINEAR = 1e-6
"""A shoulder's transform is linear (eq. 1 of the paper) if the generic angles from eq. 1 differ from the
exact ones by at most this value [rad]."""
FARTHER = np.deg2rad(25.0)
"""An elbow bends in the direction with the larger range of flexion, if the ranges of the two directions
differ by more than this angle [rad]."""
TWISTED = np.deg2rad(45.0)
"""If the ranges of flexion do not decide in which direction an elbow bends, the shoulder rotations from the
model's zero to a generic posture are compared. The direction with the smaller rotation is chosen, if the two
rotations differ by more than this angle [rad]."""


def elbow_senses(
    draft: Robot, body: FoundLimbs, points: LinkPoints, index: Mapping[str | None, int], *, left: Sign | None
) -> dict[str, Sign]:
    """Returns the direction in which each elbow's joint bends its arm, by side.

    The direction of the left elbow is `left`, if given. Without `left`, each elbow bends in the direction in
    which it can move farther. If the limits are about symmetric, the right elbow mirrors the left one, and
    that direction is chosen with which the shoulders turn less from the model's zero to the nearest of
    several usual postures. Raises DescriptionError if none of these rules decides.
    """
    own = {side: _farther(draft, body, side, index) for side in body.arms}
    if left is not None:
        return {"left": left, "right": own["right"] or _mirrored(body, left)["right"]}
    ways: list[dict[str, Sign]] = [_mirrored(body, sense) for sense in (1, -1)]
    if all(own.values()):  # two equal arms, such as ARMAR-6's, are no mirror images
        return {side: sense for side, sense in own.items() if sense is not None}
    flexions = [
        np.mean([largest_flexion(draft, body, side, way[side], index) for side in body.arms]) for way in ways
    ]
    if abs(flexions[0] - flexions[1]) > FARTHER:
        return ways[int(np.argmax(flexions))]
    turns = [
        max(
            _shoulder_turn(draft, arm(draft, body, _side(side), points, index, sense=way[side]))
            for side in body.arms
        )
        for way in ways
    ]
    if abs(turns[0] - turns[1]) > TWISTED:
        return ways[int(np.argmin(turns))]
    elbow = body.joints[body.arms["left"].bend].name
    message = (
        f"{elbow}: its limits and the arm's zero posture leave open which way the elbow bends; valid: "
        "--elbow 1 or --elbow -1, the direction in which this joint turns to bend the left arm"
    )
    raise DescriptionError(draft.source, [Fault(0, message)])


def _farther(draft: Robot, body: FoundLimbs, side: str, index: Mapping[str | None, int]) -> Sign | None:
    """The direction in which an elbow can move farther by more than FARTHER; None if there is none."""
    one, other = (largest_flexion(draft, body, side, sense, index) for sense in (1.0, -1.0))
    return None if abs(one - other) <= FARTHER else 1 if one > other else -1


def largest_flexion(
    draft: Robot, body: FoundLimbs, side: str, sense: float, index: Mapping[str | None, int]
) -> float:
    """Returns the largest generic elbow angle [rad] of an arm. `sense` is 1 if the arm bends when the elbow
    joint's own angle increases, else -1."""
    limb = body.arms[side]
    limits = draft.servos[index[body.joints[limb.bend].name]].limits
    assert limits.lower is not None
    assert limits.upper is not None
    return max(sense * limits.lower, sense * limits.upper) + bent_at_zero(body, limb, sense)


def bent_at_zero(body: FoundLimbs, limb: Limb, sense: float) -> float:
    """Returns the generic elbow angle [rad] of an arm at the model's zero. `sense` (1 or -1) is the direction
    in which the elbow joint turns to bend the arm."""
    return angle_about(sense * body.joints[limb.bend].axis, *axes_of(body, limb))


def _mirrored(body: FoundLimbs, left: Sign) -> dict[str, Sign]:
    """Returns the bending directions (1 or -1) of both elbow joints by side. `left` is that of the left
    elbow; the right elbow moves as its mirror image."""
    axes = {side: body.joints[limb.bend].axis for side, limb in body.arms.items()}
    # axes are axial vectors, so a mirror image reverses x and z
    image = left * axes["left"] * [-1.0, 1.0, -1.0]
    return {"left": left, "right": 1 if float(image @ axes["right"]) > 0.0 else -1}


def _shoulder_turn(draft: Robot, part: GenericPart) -> float:
    """Returns the rotation [rad] from the model's zero that a shoulder needs for the nearest of several usual
    postures. It is the rotation of the joint that turns farthest."""
    digest = f"{part.name} bent {part.servos[3].scale}"
    joints = joint_map(draft.model_copy(update={"parts": (part,), "digest": digest}), part.name)
    start, shoulder = np.zeros(len(draft.servos)), joints.ids < 3
    return min(float(np.abs(joints.to_robot(posture, start)[shoulder]).max()) for posture in POSTURES)


def _side(name: str) -> Side:
    return "left" if name == "left" else "right"


def arm(
    draft: Robot, body: FoundLimbs, side: Side, points: LinkPoints, index: Mapping[str | None, int], *,
    sense: Sign, mount: bool = False,
) -> GenericPart:  # fmt: skip
    """Returns the generic arm of one side: transforms, segments, and an initial posture within the limits.

    `sense` is the direction in which the elbow's joint bends the arm.
    """
    joints, limb = body.joints, body.arms[side]
    servos = [
        generic_joint(id, JOINTS[id], index[joints[joint].name], transform="retarget")
        for id, joint in enumerate(limb.ball)
    ]
    servos.append(
        generic_joint(
            3, JOINTS[3], index[joints[limb.bend].name], scale=float(sense),
            offset=bent_at_zero(body, limb, sense),
        )
    )  # fmt: skip
    if limb.turn is None:
        servos.append(GenericServo(id=4, name=JOINTS[4], servo=None))
    else:
        turn = joints[limb.turn]
        scale = side_sign(side) * float(np.sign(turn.axis @ axes_of(body, limb)[1]))
        servos.append(generic_joint(4, JOINTS[4], index[turn.name], scale=scale))
    part = GenericPart(
        name=f"{side}_arm",
        kind="arm",
        side=side,
        servos=tuple(servos),
        segments=segments(body, limb, points),
    )
    part = _linear_where_exact(draft, part, mount=mount)
    return with_initial(draft, part)


def segments(body: FoundLimbs, limb: Limb, points: LinkPoints) -> tuple[Segment, ...]:
    links = {"upper_arm": body.joints[limb.ball[-1]].link, "forearm": body.joints[limb.bend].link}
    ends = ends_of(body, limb)
    return tuple(segment(body, points, name, links[name], *ends[name]) for name in ends)


def _linear_where_exact(draft: Robot, part: GenericPart, *, mount: bool) -> GenericPart:
    """Returns the arm with eq. 1 (generic angle = factor * servo angle + offset) for its shoulder, if eq. 1
    is exact in the torso frame or, with `mount`, in another mount frame.

    If eq. 1 is not exact, the arm is returned unchanged.
    """
    shoulder = Shoulder(draft.model_copy(update={"parts": (part,)}), part)
    turns = [(0.0, 0.0, 0.0), *([found] if mount and (found := find_mount(shoulder)) else [])]
    for rpy in turns:
        R_TM = rotation_rpy(*rpy)
        sigma = shoulder.generic(shoulder.rotation(np.zeros(3)), R_TM)
        gamma = []
        for axis in np.eye(3):
            bent = shoulder.generic(shoulder.rotation(0.1 * axis), R_TM) - sigma
            gamma.append(float(np.round(bent @ axis / 0.1)))
        trials = np.random.default_rng(0).uniform(-0.4, 0.4, size=(50, 3))
        errors = [
            np.abs(shoulder.generic(shoulder.rotation(q), R_TM) - gamma * q - sigma).max() for q in trials
        ]
        if max(errors) <= LINEAR and 0.0 not in gamma:
            servos = [
                one.model_copy(update={"transform": "linear", "scale": g, "offset": float(np.round(s, 12))})
                for one, g, s in zip(part.servos[:3], gamma, sigma, strict=True)
            ]
            return part.model_copy(update={"servos": (*servos, *part.servos[3:]), "mount": rpy})
    return part
