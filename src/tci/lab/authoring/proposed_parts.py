"""Proposes legs, hands, head and torso. The joints of the model are matched to generic joints by the
directions of their axes, and the transforms are linear.

At generic angles of zero, the robot stands with straight legs, level feet and hanging arms. The offset of a
joint is its generic angle in the zero posture of the model file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tci.lab.authoring.find_legs import ALIKE, SLANTED, Leg
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.limb import Limb
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.sleeves import three
from tci.messages.frames import Array, rpy_of
from tci.robot.description import GenericPart, GenericServo, Robot, Segment
from tci.robot.description.part import MAX_MOUNT
from tci.robot.generic_arm import Side, forearm_rotation
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import Shoulder, angle_about, cross_matrix

GENERIC_SPEED = float(np.deg2rad(180.0))
"""Speed limit [rad/s] of generic joints. Assumed: fast enough for a withdrawal. The speed limits of the
servos also apply."""
LEG = {
    "hip_pitch": (0.0, -1.0, 0.0), "hip_roll": (1.0, 0.0, 0.0), "hip_yaw": (0.0, 0.0, -1.0),
    "knee_pitch": (0.0, 1.0, 0.0), "ankle_pitch": (0.0, -1.0, 0.0), "ankle_roll": (-1.0, 0.0, 0.0),
}  # fmt: skip
"""Axes of positive rotation of a straight left leg, in the torso frame."""
HAND = {"flexion": (-1.0, 0.0, 0.0), "deviation": (0.0, -1.0, 0.0)}
"""Axes of positive rotation of a left hand, in the frame of the forearm while all generic angles of the arm
are 0: the torso frame, if it hangs there."""
STANDING = np.deg2rad([20.0, 0.0, 0.0, 40.0, 20.0, 0.0])
"""Initial posture [rad] of legs, if the limits allow this posture. Assumed: slightly bent knees, level
feet."""
ROOM = np.deg2rad(3.0)
"""Distance [rad] of the initial posture from limits. Assumed: larger than encoder offsets."""


def generic_joint(id: int, name: str, servo: int | None, **more: object) -> GenericServo:
    """Returns a generic joint with a speed limit of 180 degrees per second."""
    return GenericServo.model_validate(
        {"id": id, "name": name, "servo": servo, "speed": GENERIC_SPEED, **more}
    )


def middle(
    body: FoundLimbs, kind: str, joints: Sequence[int], index: Mapping[str | None, int], *, sense: float = 1.0
) -> GenericPart:
    """Returns the generic head or torso, as named by `kind`.

    Pitch nods forward, roll leans right, yaw turns left. A generic joint without a matching joint in `joints`
    is fixed. `joints` are in order from the torso; if several joints are parallel, the joint nearest to the
    torso is used. `sense` is 1 for joints that carry the part. `sense` is -1 for waist joints in a model
    whose root is the torso: such a joint moves the legs, so its sign is inverted.
    """
    servos = []
    for id, (name, axis) in enumerate(zip(("pitch", "roll", "yaw"), np.eye(3)[[1, 0, 2]], strict=True)):
        found = next((place for place in joints if abs(body.joints[place].axis @ axis) > ALIKE), None)
        if found is None:
            servos.append(GenericServo(id=id, name=name, servo=None))
        else:
            scale = sense * float(np.sign(body.joints[found].axis @ axis))
            servos.append(generic_joint(id, name, index[body.joints[found].name], scale=scale))
    return GenericPart.model_validate({"name": kind, "kind": kind, "servos": tuple(servos)})


def leg(
    draft: Robot, body: FoundLimbs, found_leg: Leg, side: Side, points: LinkPoints,
    index: Mapping[str | None, int],
) -> GenericPart:  # fmt: skip
    """Returns the generic leg. Each of its joints is matched to a joint of the robot with a similar axis."""
    mirror = np.array([1.0, 1.0, 1.0] if side == "left" else [-1.0, 1.0, -1.0])
    wanted = {name: mirror * axis for name, axis in LEG.items()}
    chain, hip, knee, ankle = found_leg.chain, found_leg.hip, found_leg.knee, found_leg.ankle
    above, below = chain[: chain.index(knee)], chain[chain.index(knee) + 1 :]
    found = _matched(body, [hip], {"hip_pitch": wanted["hip_pitch"]})
    found |= _matched(
        body, [one for one in above if one != hip], {name: wanted[name] for name in ("hip_roll", "hip_yaw")}
    )
    found |= _matched(body, [knee], {"knee_pitch": wanted["knee_pitch"]})
    found |= _matched(body, below, {name: wanted[name] for name in ("ankle_pitch", "ankle_roll")})
    tip = body.joints[ankle].anchor
    bend = body.joints[knee]
    middle = bend.anchor + bend.axis * float(bend.axis @ (tip - bend.anchor))
    start = body.joints[hip].anchor
    start = start + body.joints[hip].axis * float(body.joints[hip].axis @ (middle - start))
    thigh, shank = middle - start, tip - middle
    if "hip_yaw" in found and found["hip_yaw"][0] == above[-1]:
        axis = body.joints[above[-1]].axis
        thigh = (
            axis * float(np.sign(axis @ thigh)) * float(np.linalg.norm(thigh))
        )  # the thigh is measured along the axis of hip yaw
    across, ahead, down = np.array([0.0, -1.0, 0.0]), mirror * [1.0, 0.0, 0.0], np.array([0.0, 0.0, -1.0])
    pitch, flexion = angle_about(across, down, thigh), -angle_about(across, thigh, shank)
    roll = angle_about(ahead, down, shank)
    offsets = {"hip_pitch": pitch, "hip_roll": roll, "knee_pitch": flexion,
               "ankle_pitch": flexion - pitch, "ankle_roll": roll}  # fmt: skip
    servos = []
    for id, name in enumerate(LEG):
        if name not in found:
            servos.append(GenericServo(id=id, name=name, servo=None))
            continue
        place, scale = found[name]
        servo = index[body.joints[place].name]
        offset = round(offsets.get(name, 0.0), 9) + 0.0
        initial = _inside(draft, servo, scale, offset, STANDING[id])
        servos.append(generic_joint(id, name, servo, scale=scale, offset=offset, initial=initial))
    segments = (
        segment(body, points, "thigh", body.joints[above[-1]].link, middle - thigh, middle),
        segment(body, points, "shank", bend.link, middle, tip),
    )
    return GenericPart(name=f"{side}_leg", kind="leg", side=side, servos=tuple(servos), segments=segments)


def hand(
    draft: Robot, body: FoundLimbs, limb: Limb, arm: GenericPart, index: Mapping[str | None, int]
) -> GenericPart | None:
    """Returns the generic hand with the wrist joints of an arm; None if no joint fits.

    Axes are compared in the frame of the forearm, while all generic angles of the arm are 0. Thus the zero of
    pronation decides which joint of the wrist is flexion.
    """
    assert arm.side is not None
    robot = draft.model_copy(update={"parts": (arm,), "digest": f"{arm.name} and its hand"})
    joints = joint_map(robot, arm.name)
    position = np.zeros(len(draft.servos))
    position[joints.servos] = joints.to_robot(np.zeros(5), position)
    kinematics = KinematicChain(robot)
    R_TF = arm.R_TM @ forearm_rotation(joints.to_generic(position), arm.side, axial=True)
    mirror = np.array([1.0, 1.0, 1.0] if arm.side == "left" else [-1.0, 1.0, -1.0])
    servos, free = [], wrist(body, limb)
    for id, (name, axis) in enumerate(HAND.items()):
        fit = GenericServo(id=id, name=name, servo=None)
        for place in free:
            servo = index.get(body.joints[place].name)
            if servo is None:
                continue
            turns = R_TF.T @ kinematics.jacobian(position, body.joints[place].link)[3:, servo]
            along = float(turns @ (mirror * axis))
            if abs(along) > ALIKE:
                scale = float(np.sign(along))
                fit = generic_joint(
                    id, name, servo, scale=scale, initial=_inside(draft, servo, scale, 0.0, 0.0)
                )
        servos.append(fit)
    if all(fit.servo is None for fit in servos):
        return None
    return GenericPart(name=f"{arm.side}_hand", kind="hand", side=arm.side, servos=tuple(servos))


def segment(body: FoundLimbs, points: LinkPoints, name: str, link: str, begin: Array, end: Array) -> Segment:
    """Returns a segment of a limb, on the link `link`. The segment goes from `begin` to `end` (3,) [m], which
    are points in the frame H (origin at the model's root, x forward, y left, z up)."""
    R_RL, p_RL = points.link_pose(link)
    origin = R_RL.T @ (body.R_RH @ begin - p_RL)
    return Segment(name=name, link=link, origin=three(origin), length=float(np.linalg.norm(end - begin)))


def find_mount(shoulder: Shoulder) -> tuple[float, float, float] | None:
    """Finds the mount (roll, pitch, yaw) [rad] of a shoulder whose first joint is flexion. The mount is the
    smallest rotation that turns the y axis to the axis of this joint. Returns None if this rotation exceeds
    the limit for mounts.
    """
    axis = shoulder.axes[0] * (1.0 if shoulder.axes[0][1] >= 0.0 else -1.0)
    across = np.cross([0.0, 1.0, 0.0], axis)
    sine, cosine = float(np.linalg.norm(across)), float(axis[1])
    if np.arctan2(sine, cosine) > MAX_MOUNT:
        return None
    if sine < 1e-9:
        return 0.0, 0.0, 0.0
    skew = cross_matrix(across / sine)
    roll, pitch, yaw = rpy_of(np.eye(3) + sine * skew + (1.0 - cosine) * skew @ skew)
    return roll, pitch, yaw


def _matched(
    body: FoundLimbs, joints: Sequence[int], wanted: Mapping[str, Array]
) -> dict[str, tuple[int, float]]:
    """Matches each of the `wanted` axes (unit vectors (3,) by name) to one of `joints` with a similar axis.

    Returns, by the name of each matched axis, the joint and a sign: 1 if the joint's axis points along the
    wanted axis, -1 if it points the opposite way.
    """
    found: dict[str, tuple[int, float]] = {}
    for name, axis in wanted.items():
        for place in joints:
            along = float(body.joints[place].axis @ axis)
            if abs(along) > SLANTED and place not in [taken for taken, _ in found.values()]:
                found[name] = place, float(np.sign(along))
                break
    return found


def wrist(body: FoundLimbs, limb: Limb) -> list[int]:
    """Returns the wrist: the first two joints, or fewer, after the pronation of an arm.

    Joints after a branch, such as the fingers on a palm, do not belong to the wrist.
    """
    start = limb.bend if limb.turn is None else limb.turn
    chain: list[int] = []
    after = [start]
    while len(after) == 1:
        if after[0] != start:
            chain.append(after[0])
        after = [place for place, one in enumerate(body.joints) if one.parent == after[0]]
    return chain[:2]


def _inside(draft: Robot, servo: int, scale: float, offset: float, wanted: float) -> float:
    """Returns the generic angle [rad] nearest to `wanted` at which the servo is at least 3 degrees from its
    limits, or less if the limits are close to each other. The generic angle is `scale` * servo angle +
    `offset` [rad]."""
    limits = draft.servos[servo].limits
    assert limits.lower is not None
    assert limits.upper is not None
    ends = sorted(scale * limit + offset for limit in (limits.lower, limits.upper))
    room = min(ROOM, 0.4 * (ends[1] - ends[0]))
    return float(np.clip(wanted, ends[0] + room, ends[1] - room))
