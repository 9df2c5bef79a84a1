"""Proposes a description of a humanoid from its URDF alone.

Arms come from the geometry by the generic arm's definition, limits from the file, sleeves of skin from the
shapes of the links. Values that the URDF does not contain are proposed and marked as assumed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from lxml import etree

from tci.authoring.find_limbs import FoundLimbs, Limb, find_limbs
from tci.authoring.link_points import LinkPoints
from tci.authoring.proposed_parts import find_legs, find_mount, generic_joint, hand, leg, middle, segment
from tci.authoring.sleeves import axes_of, ends_of, sleeves
from tci.errors import DescriptionError, Fault
from tci.frames import Array, rotation_rpy, rpy_of
from tci.messages import Mode
from tci.robot.description import (
    GenericPart,
    GenericServo,
    Limits,
    Model,
    Robot,
    Segment,
    Servo,
)
from tci.robot.generic_arm import JOINTS, Side, side_sign
from tci.robot.joint_map import joint_map
from tci.robot.shoulder import Shoulder, angle_about
from tci.robot.xml.document import parse, read_bytes
from tci.robot.xml.model import MAX_MODEL_BYTES

# All values below are assumed.
SPEED = np.deg2rad(120.0)
"""Speed limit [rad/s] where the file gives none, or a placeholder."""
FASTEST = 50.0
"""Speed limit [rad/s] from which the file's value counts as a placeholder."""
ACCELERATION = np.deg2rad((400.0, 2400.0))
"""Least and largest acceleration limit [rad/s2]; between them that of the largest inertia by a quarter of the
torque."""
MOST_TORQUE = 0.35
"""Largest fraction of the torque for that, where the least acceleration takes more than a quarter."""
JERK = 100.0
"""Ratio of the limits of jerk and acceleration [1/s]."""
TORQUE, STRONGEST = 40.0, 1e4
"""Torque limit [N m] where the file gives none, and value from which the file's counts as a placeholder."""
POSTURES = np.deg2rad([[25, 25, 0, 60, 0], [25, 25, 0, 75, 0], [35, 30, 0, 60, 0], [20, 40, 0, 60, 0],
                       [40, 20, 10, 70, 0], [25, 15, -15, 50, 0], [15, 15, 0, 45, 0]])  # fmt: skip
"""Candidates for the initial posture [rad]; the first that fits is taken."""
SHORTEST = 0.02
"""Least length [m] of a forearm."""
ROOM = 0.1
"""Distance [rad] of the initial posture from limits that suffices."""
LINEAR = 1e-6
"""Error [rad] up to which a shoulder counts as linear (eq. 1)."""


def propose(path: Path, *, name: str, package: str | None = None, mount: bool = False) -> Robot:
    """Proposes the description of the robot whose URDF is at `path`, for review by a person.

    `package` is the installed Python package that contains the URDF. With `mount`, shoulders that equal the
    generic one except for a small rotation get eq. 1 on a mount; otherwise they are retargeted, in the torso
    frame. Raises DescriptionError for a file that is no URDF of a humanoid with two arms, or in which a
    forearm's end can't be found.
    """
    model = Model(format="urdf", path=str(path.resolve()), package=package, torso_link="?")
    body = find_limbs(model)
    points = LinkPoints(model)
    rpy = rpy_of(body.T_ET[:3, :3])
    model = model.model_copy(
        update={"torso_link": body.torso_link, "torso_rpy": tuple(round(a, 9) for a in rpy)}
    )
    servos = _servos(body, model, points)
    index = {servo.joint: servo.index for servo in servos}
    draft = Robot(
        name=name, title=f"{name}, proposed from {path.name}", source=str(path), digest="", model=model,
        servos=servos, parts=(),
    )  # fmt: skip
    parts, patches = [], []
    for side, limb in body.arms.items():
        if np.linalg.norm(limb.wrist - limb.middle) < SHORTEST:
            elbow = body.joints[limb.bend].name
            message = f"no joint after {elbow} says where the {side} forearm ends; valid: one at the wrist"
            raise DescriptionError(str(path), [Fault(0, message)])
        arm = _arm(draft, body, limb, _side(side), points, index, mount=mount)
        parts.append(arm)
        patches += sleeves(body, limb, arm, points)
    parts += [middle(body, "head", body.head, index), middle(body, "torso", body.trunk, index)]
    hands = [
        hand(draft, body, limb, arm, index) for limb, arm in zip(body.arms.values(), parts, strict=False)
    ]
    parts += [one for one in hands if one is not None]
    parts += [leg(draft, body, chain, side, points, index) for side, chain in find_legs(body).items()]
    return draft.model_copy(update={"parts": tuple(parts), "patches": tuple(patches)})


def _servos(body: FoundLimbs, model: Model, points: LinkPoints) -> tuple[Servo, ...]:
    """Returns a servo for each actuated joint, limb by limb."""
    urdf = parse(read_bytes(Path(model.path), limit=MAX_MODEL_BYTES), model.path)
    described = {joint.get("name"): joint for joint in urdf.iterfind("joint")}
    groups: dict[str, Iterable[int]] = {"torso": body.trunk, "head": body.head}
    groups |= {f"{side}_arm": body.behind(_first(body, limb)) for side, limb in body.arms.items()}
    groups |= {f"{side}_leg": body.behind(chain[0]) for side, chain in find_legs(body).items()}
    named = {joint for group in groups.values() for joint in group}
    groups["other"] = [joint for joint in range(len(body.joints)) if joint not in named]
    inertia = points.inertia([joint.name for joint in body.joints])
    servos: list[Servo] = []
    for part, joints in groups.items():
        own = [joint for joint in joints if described[body.joints[joint].name].find("mimic") is None]
        for id, joint in enumerate(own):
            name = body.joints[joint].name
            servos.append(
                Servo(
                    index=len(servos), robot_part=part, id=id, name=name, joint=name,
                    limits=_limits(described[name], float(inertia[joint])),
                    modes=(Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE),
                )
            )  # fmt: skip
    return tuple(servos)


def _side(name: str) -> Side:
    return "left" if name == "left" else "right"


def _first(body: FoundLimbs, limb: Limb) -> int:
    """Returns the first joint that carries only this limb, which may be a collar bone before the shoulder."""
    joint = limb.ball[0]
    others = {limb.ball[0] for limb in (*body.arms.values(), *body.legs.values())}
    while (parent := body.joints[joint].parent) >= 0 and len(others & set(body.behind(parent))) == 1:
        if parent in body.trunk:
            break
        joint = parent
    return joint


def _limits(joint: etree._Element, inertia: float) -> Limits:
    """Returns a joint's limits. Values that the file lacks, or gives as placeholders, are assumed."""
    limit = joint.find("limit")
    given = {key: float(limit.get(key, 0.0)) for key in ("lower", "upper", "velocity", "effort")} if (
        limit is not None) else dict.fromkeys(("lower", "upper", "velocity", "effort"), 0.0)  # fmt: skip
    assumed = ["acceleration", "jerk"]
    lower, upper = given["lower"], given["upper"]
    if joint.get("type") == "continuous" or not lower < upper or max(-lower, upper) > 2.0 * np.pi:
        lower, upper = -np.pi, np.pi
        assumed += ["lower", "upper"]
    velocity, torque = given["velocity"], given["effort"]
    if not 0.0 < velocity < FASTEST:
        velocity = float(SPEED)
        assumed.append("velocity")
    if not 0.0 < torque < STRONGEST:
        torque = TORQUE
        assumed.append("torque")
    able = torque / max(inertia, 1e-6)
    acceleration = float(np.clip(0.25 * able, min(ACCELERATION[0], MOST_TORQUE * able), ACCELERATION[1]))
    acceleration = float(np.deg2rad(10.0 * np.floor(np.rad2deg(acceleration) / 10.0 + 1e-9)))
    return Limits(
        lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=JERK * acceleration,
        torque=torque, assumed=tuple(assumed),
    )  # fmt: skip


def _arm(
    draft: Robot,
    body: FoundLimbs,
    limb: Limb,
    side: Side,
    points: LinkPoints,
    index: Mapping[str | None, int],
    *,
    mount: bool,
) -> GenericPart:
    """Returns the generic arm: transforms, segments, and an initial posture that fits."""
    joints = body.joints
    upper, forearm = axes_of(body, limb)
    # Generic flexion is 0 with a straight elbow: of both signs, the one with the larger range is taken.
    elbow = joints[limb.bend]
    limits = draft.servos[index[elbow.name]].limits
    assert limits.lower is not None
    assert limits.upper is not None
    ways = []
    for sign in (1.0, -1.0):
        straight = angle_about(sign * elbow.axis, upper, forearm)
        ways.append((max(sign * limits.lower, sign * limits.upper) + straight, sign, straight))
    _, scale, offset = max(ways)
    servos = [
        generic_joint(id, JOINTS[id], index[joints[joint].name], transform="retarget")
        for id, joint in enumerate(limb.ball)
    ]
    servos.append(generic_joint(3, JOINTS[3], index[elbow.name], scale=scale, offset=offset))
    if limb.turn is None:
        servos.append(GenericServo(id=4, name=JOINTS[4], servo=None))
    else:
        turn = joints[limb.turn]
        scale = side_sign(side) * float(np.sign(turn.axis @ forearm))
        servos.append(generic_joint(4, JOINTS[4], index[turn.name], scale=scale))
    part = GenericPart(
        name=f"{side}_arm",
        kind="arm",
        side=side,
        servos=tuple(servos),
        segments=_segments(body, limb, points),
    )
    part = _linear_where_exact(draft, part, mount=mount)
    return _with_initial(draft, part)


def _segments(body: FoundLimbs, limb: Limb, points: LinkPoints) -> tuple[Segment, ...]:
    links = {"upper_arm": body.joints[limb.ball[2]].link, "forearm": body.joints[limb.bend].link}
    ends = ends_of(body, limb)
    return tuple(segment(body, points, name, links[name], *ends[name]) for name in ends)


def _linear_where_exact(draft: Robot, part: GenericPart, *, mount: bool) -> GenericPart:
    """Returns the arm with eq. 1 for its shoulder where that is exact, in the torso frame or on a mount.

    An arm without an exact solution is returned unchanged.
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


def _with_initial(draft: Robot, part: GenericPart) -> GenericPart:
    """Returns the part with the first of POSTURES that keeps its servos away from their limits."""
    joints = joint_map(draft.model_copy(update={"parts": (part,), "digest": part.name}), part.name)
    limits = [draft.servos[servo].limits for servo in joints.servos]
    lower, upper = np.array([[limit.lower, limit.upper] for limit in limits], dtype=float).T
    start = np.zeros(len(draft.servos))

    def room(posture: Array) -> float:
        angles = joints.to_robot(posture, start)
        there = np.array(start)
        there[joints.servos] = angles
        missed = np.abs(joints.to_generic(there) - posture)[joints.ids].max()
        return float(np.minimum(angles - lower, upper - angles).min() - 10.0 * missed)

    rooms = [room(posture) for posture in POSTURES]
    best = POSTURES[int(np.argmax(np.minimum(rooms, ROOM)))]
    if max(rooms) < 0.0:
        inside = np.array(start)
        inside[joints.servos] = np.clip(joints.to_robot(best, start), lower, upper)
        best = joints.to_generic(inside)
    servos = [j.model_copy(update={"initial": float(a)}) for j, a in zip(part.servos, best, strict=True)]
    return part.model_copy(update={"servos": tuple(servos)})
