"""Proposes the generic arm of a robot with one arm on a table, a wall or a ceiling.

Its mount is turned so that the generic shoulder is the arm's own: pitch is the pan, roll the lift, and yaw
turns the upper arm. At generic zero the arm is stretched out forward, square to the pan's axis. A positive
roll raises it from what carries it. The elbow bends the forearm back towards there at a yaw of 90 degrees,
and away from there at -90. An arm with two joints at the shoulder has one of these as its fixed yaw. So eq. 1
of the paper is exact for all joints.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.initial_posture import with_initial
from tci.lab.authoring.joint_tree import Joint
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_arm import FARTHER, Sign, bent_at_zero, segments
from tci.lab.authoring.proposed_parts import generic_joint
from tci.lab.authoring.sleeves import axes_of
from tci.messages.frames import Array, rotation_rpy, rotation_x, rotation_y, rpy_of
from tci.robot.description import GenericPart, GenericServo, Robot
from tci.robot.generic_arm import JOINTS, Side, side_sign, upper_arm_rotation
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import angle_about

SQUARE = 2e-3
"""Largest error [rad] of the upper arm's direction by eq. 1: models are rounded to 0.1 degrees at worst.
Assumed."""
TRIALS = 20
"""Number of random postures in which the proposed angles are compared with the model's axes."""


def lone_arm(
    draft: Robot, body: FoundLimbs, points: LinkPoints, index: Mapping[str | None, int], *, elbow: Sign | None
) -> GenericPart:
    """The generic arm of a robot with one arm: transforms, mount, segments, and an initial posture within the
    limits.

    `elbow` is the direction in which the elbow's joint bends the arm. None: that in which it can move
    farther; if both are alike, that in which it lowers the forearm of an arm that is stretched out forward.
    Raises DescriptionError if the axes of the shoulder are not square to each other.
    """
    assert body.outward is not None
    (name, limb), joints = next(iter(body.arms.items())), body.joints
    side: Side = "left" if name == "left" else "right"
    s, up = side_sign(side), body.outward
    R_TM = _mount(up, side)
    pan, lift = joints[limb.ball[0]], joints[limb.ball[1]]
    upper = axes_of(body, limb)[0]
    # of the two pans at which the lift's axis is the generic one, the nearer
    pitch = angle_about(-R_TM[:, 1], R_TM[:, 0], lift.axis)
    if abs(pitch) > np.pi / 2.0 + 1e-6:
        pitch -= np.pi * float(np.sign(pitch))
    R_TP = R_TM @ rotation_y(-pitch)
    ahead, across = -R_TP[:, 2], s * R_TP[:, 0]
    roll = angle_about(across, ahead, upper)
    R_TR = R_TP @ rotation_x(s * roll)
    bending, flexed = joints[limb.bend], bent_at_zero(body, limb, 1.0)
    usual: Sign = 1 if float(bending.axis @ -across) > 0.0 else -1
    ways = {way: _generic(draft, 3, index, bending, way, way * flexed) for way in (usual, _other(usual))}
    farther = _range(draft, ways[_other(usual)])[1] - _range(draft, ways[usual])[1] > FARTHER
    sense = elbow or (_other(usual) if farther else usual)
    bend = sense * joints[limb.bend].axis
    yaw = angle_about(s * upper, -R_TR[:, 1], bend)
    servos = [
        _joint(draft, 0, index, pan, -R_TM[:, 1], pitch),
        _joint(draft, 1, index, lift, across, roll),
    ]
    if len(limb.ball) > 2:
        servos.append(_joint(draft, 2, index, joints[limb.ball[2]], s * upper, yaw))
    else:
        servos.append(GenericServo(id=2, name=JOINTS[2], servo=None, fixed=_clean(yaw), initial=_clean(yaw)))
    servos.append(ways[sense])
    if limb.turn is None:
        servos.append(GenericServo(id=4, name=JOINTS[4], servo=None))
    else:
        servos.append(_joint(draft, 4, index, joints[limb.turn], s * axes_of(body, limb)[1], 0.0))
    part = GenericPart(
        name=f"{side}_arm", kind="arm", side=side, servos=tuple(servos), mount=rpy_of(R_TM),
        segments=segments(body, limb, points),
    )  # fmt: skip
    _check_square(draft, part)
    return with_initial(draft, part)


def _mount(up: Array, side: Side) -> Array:
    """Rotation (3, 3) of the mount in the torso frame: its y axis is along the pan, its z axis points
    back."""
    level = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.5 else np.array([0.0, 0.0, 1.0])
    y, z = side_sign(side) * up, -(level - up * float(up @ level))
    z /= np.linalg.norm(z)
    return np.column_stack([np.cross(y, z), y, z])


def _other(sense: Sign) -> Sign:
    return -1 if sense > 0 else 1


def _check_square(draft: Robot, part: GenericPart) -> None:
    """Raises DescriptionError if the upper arm's direction in the model and that of the generic arm
    differ."""
    assert part.side is not None
    chain = KinematicChain(draft)
    moved = [(one.servo, one.scale, one.offset) for one in part.servos if one.servo is not None]
    shoulder = [one.servo for one in part.servos[:3] if one.servo is not None]
    generator, worst = np.random.default_rng(0), 0.0
    start: Array | None = None
    for trial in range(TRIALS):
        position = np.zeros(len(draft.servos))
        if trial:
            position[shoulder] = generator.uniform(-1.0, 1.0, len(shoulder))
        posture = part.initial_posture * 0.0
        for one in part.servos:
            posture[one.id] = one.fixed if one.servo is None else one.scale * position[one.servo] + one.offset
        R_TL = chain.poses(position, [part.segment("upper_arm").link])[part.segment("upper_arm").link][:3, :3]
        generic = rotation_rpy(*part.mount) @ upper_arm_rotation(posture, part.side, axial=True)
        start = R_TL.T @ generic if start is None else start
        worst = max(worst, float(np.abs(R_TL.T @ generic - start).max()))
    if worst > SQUARE:
        names = ", ".join(draft.servos[servo].name for servo, _, _ in moved[: len(shoulder)])
        message = (
            f"{names}: the axes of the shoulder are not square to each other ({np.rad2deg(worst):.2g} "
            "degrees); valid: a pan, a lift square to it, and a turn of the upper arm about its length"
        )
        raise DescriptionError(draft.source, [Fault(0, message)])


def _joint(
    draft: Robot, id: int, index: Mapping[str | None, int], joint: Joint, axis: Array, offset: float
) -> GenericServo:
    """The generic joint `id` that turns about `axis` (3,), by a joint of the model along it, and is at
    `offset` [rad] while this joint is at 0."""
    scale = 1.0 if float(joint.axis @ axis) > 0.0 else -1.0
    return _generic(draft, id, index, joint, scale, offset)


def _generic(
    draft: Robot, id: int, index: Mapping[str | None, int], joint: Joint, scale: float, offset: float
) -> GenericServo:
    """A generic joint. A whole turn is added to its `offset` [rad] if so the middle of its range is nearer
    to 0."""
    servo = index[joint.name]
    middle = offset + scale * float(
        np.mean([draft.servos[servo].limits.lower, draft.servos[servo].limits.upper])
    )
    turns = 2.0 * np.pi * np.round(middle / (2.0 * np.pi))
    return generic_joint(id, JOINTS[id], servo, scale=scale, offset=_clean(offset - turns))


def _range(draft: Robot, joint: GenericServo) -> tuple[float, float]:
    """Generic angles [rad] that the limits of the joint's servo allow."""
    assert joint.servo is not None
    limits = draft.servos[joint.servo].limits
    assert limits.lower is not None
    assert limits.upper is not None
    low, high = sorted(joint.scale * end + joint.offset for end in (limits.lower, limits.upper))
    return low, high


def _clean(angle: float) -> float:
    return round(float(angle), 12) + 0.0
