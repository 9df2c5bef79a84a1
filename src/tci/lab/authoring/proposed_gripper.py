"""Proposes a gripper as a hand of a thumb and an index finger: its motors, how its jaws follow them, and pads
on its jaws and between them.

A jaw that slides follows its motor as a rack follows a pinion. The pinion's radius is the jaw's whole way, so
that every gripper closes within 1 rad of flexion. The flexion of a jaw that swings is its angle. All jaws are
open at 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_jaws import Gripper, Jaw
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.joint_facts import JAW_TORQUE, JointFacts, proposed_limits
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_fingers import SHORTEST
from tci.lab.authoring.proposed_parts import ROOM, generic_joint, segment
from tci.lab.authoring.sleeves import three
from tci.messages import Mode
from tci.messages.frames import Array, rpy_of
from tci.robot.description import GenericPart, GenericServo, Grid, Mimic, Patch, Robot, Sensor, Servo
from tci.robot.description.part import Term
from tci.robot.generic_arm import Side
from tci.robot.generic_fingers import JOINTS, PALM
from tci.support.engine import mujoco

NAMES = ("thumb", "index")
"""Fingers as which the jaws count, in the order of the model; a jaw that closes against a fixed one is the
index finger."""
PITCH = 0.004
"""Distance [m] between taxels of an assumed pad."""
FLAT, HIGH = 0.0015, 0.9
"""A pad lies at the quantile HIGH of the heights of a face, across all that is at most FLAT [m] lower: over
the hollow of a jaw with rims, as the convex hulls of a simulation do."""
LARGEST, LEAST = 0.03, 0.008
"""Largest and least side [m] of an assumed pad."""
GRASPS = 0.02
"""Length [m] of a jaw, from its tip, within which its pad is."""


@dataclass(frozen=True, slots=True)
class _Drive:
    """How a joint follows a servo: place of the joint = `slope` * servo angle + `offset`."""

    servo: Servo
    slope: float
    offset: float


def gripper_servos(
    gripper: Gripper, facts: Mapping[str, JointFacts], points: LinkPoints, side: Side, *, first: int
) -> tuple[Servo, ...]:
    """A servo for each joint of the gripper that follows no other one; those that do follow it. The first
    has the index `first`. A joint in a linkage without a motor and without a leader stays at zero."""
    model = points.compiled
    inertia = dict(zip(gripper.joints, points.inertia(gripper.joints).tolist(), strict=True))
    driven = [name for jaw in gripper.jaws for name in jaw.joints]
    leaders = list(dict.fromkeys(_leader(name, facts, points)[0] for name in driven))
    leaders = [name for name in leaders if not facts[name].stuck]
    servos = []
    for id, name in enumerate(leaders):
        radius = _radius(name, facts, points) if _slides(model, name) else 1.0
        own, load = facts[name], inertia.get(name, float(points.inertia([name])[0]))
        turned = replace(
            own, lower=own.lower / radius, upper=own.upper / radius, velocity=own.velocity / radius,
            torque=own.torque * radius, friction=own.friction * radius, damping=own.damping * radius**2,
        )  # fmt: skip
        mimics: list[Mimic] = []
        for joint in (name, *gripper.joints):
            leader, slope, offset = _leader(joint, facts, points)
            slides = _slides(model, joint)
            if leader == name and (slides or joint != name) and all(joint != one.joint for one in mimics):
                mimics.append(Mimic(joint=joint, multiplier=slope * radius, offset=offset, slides=slides))
        servos.append(
            Servo(
                index=first + id, robot_part=f"{side}_gripper", id=id, name=name,
                joint=None if _slides(model, name) else name, mimics=tuple(mimics),
                limits=proposed_limits(turned, load * radius**2, motor=JAW_TORQUE),
                modes=(Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE),
            )
        )  # fmt: skip
    return tuple(servos)


def jaws(draft: Robot, body: FoundLimbs, gripper: Gripper, points: LinkPoints, side: Side) -> GenericPart:
    """The generic fingers of a gripper."""
    drives = {
        joint.joint: _Drive(servo, joint.multiplier, joint.offset)
        for servo in draft.servos for joint in servo.joints
    }  # fmt: skip
    rows = {f"{name}_flexion": _flexion(jaw, drives) for name, jaw in _named(gripper).items()}
    shared = Counter(servo for factors, _ in rows.values() for servo in factors)
    servos = tuple(
        _generic(id, name, draft, *rows.get(name, ({}, 0.0)), shared) for id, name in enumerate(JOINTS)
    )
    segments = [
        segment(body, points, name, jaw.link, jaw.anchor @ body.R_RH, jaw.tip @ body.R_RH)
        for name, jaw in _named(gripper).items()
    ]
    base = np.mean([jaw.anchor for jaw in gripper.jaws], axis=0)
    start = points.link_pose(gripper.palm)[1]
    if np.linalg.norm(base - start) < SHORTEST:
        base = np.mean([jaw.tip for jaw in gripper.jaws], axis=0)
    segments.append(segment(body, points, PALM, gripper.palm, start @ body.R_RH, base @ body.R_RH))
    return GenericPart(
        name=f"{side}_fingers", kind="fingers", side=side, servos=servos, segments=tuple(segments)
    )


def jaw_pads(gripper: Gripper, part: GenericPart, points: LinkPoints) -> list[Patch]:
    """Assumed pads, where the model has shapes: one on the palm between the jaws, and one on the inner face
    of each jaw's tip."""
    tips = np.mean([jaw.tip for jaw in gripper.jaws], axis=0)
    base = np.mean([jaw.anchor for jaw in gripper.jaws], axis=0)
    ahead = tips - base
    pads = []
    for name, jaw in _named(gripper).items():
        inward = jaw.closes * (jaw.axis if jaw.slides else np.cross(jaw.axis, jaw.tip - jaw.anchor))
        along = _square(ahead if jaw.slides else jaw.tip - jaw.anchor, inward)
        inward = inward / np.linalg.norm(inward)
        shape = points.of([jaw.link])
        reach = shape @ along
        near = shape[reach > reach.max() - GRASPS] if len(shape) else shape
        pads += _pad(f"{part.side}_{name}_pad", part, name, near, inward, along, points)
    if len(gripper.jaws) == 1:  # the palm's pad is on the fixed jaw, which faces the other one
        shape = points.of([gripper.palm])
        near = shape[np.abs(shape @ along - jaw.tip @ along) < GRASPS] if len(shape) else shape
        return _pad(f"{part.side}_palm", part, PALM, near, -inward, along, points) + pads
    across = _square(gripper.jaws[0].axis if gripper.jaws[0].slides else gripper.jaws[0].tip - tips, ahead)
    shape, out = points.of([gripper.palm]), ahead / np.linalg.norm(ahead)
    off = shape - base
    off = off - np.outer(off @ out, out)
    near = shape[np.linalg.norm(off, axis=1) < 0.5 * GRASPS] if len(shape) else shape
    return _pad(f"{part.side}_palm", part, PALM, near, out, across, points) + pads


def _named(gripper: Gripper) -> dict[str, Jaw]:
    return dict(zip(NAMES[-len(gripper.jaws) :], gripper.jaws, strict=True))


def _slides(model: mujoco.MjModel, joint: str) -> bool:
    return bool(model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_SLIDE)


def _leader(name: str, facts: Mapping[str, JointFacts], points: LinkPoints) -> tuple[str, float, float]:
    """The joint that leads `name`, itself if it follows none, and slope and offset of `name` by that
    joint."""
    slope, offset = 1.0, 0.0
    seen = {name}
    while (given := facts[name]).follows:
        slope, offset, name = slope * given.multiplier, offset + slope * given.offset, given.follows
        if name in seen or name not in facts:
            message = f"{name} is followed, and leads nothing that moves; valid: a joint of the model"
            raise DescriptionError(points.source, [Fault(0, message)])
        seen.add(name)
    return name, slope, offset


def _radius(name: str, facts: Mapping[str, JointFacts], points: LinkPoints) -> float:
    way = facts[name].upper - facts[name].lower
    if not way > 0.0:
        message = f"{name} slides and has no limits; valid: a model with the limits of its jaws"
        raise DescriptionError(points.source, [Fault(0, message)])
    return round(way, 9)


def _flexion(jaw: Jaw, drives: Mapping[str, _Drive]) -> tuple[dict[int, float], float]:
    """Factors by servo index, and an offset [rad]: the flexion is the sum of factor * servo angle, plus the
    offset. A further joint with a motor of its own turns against the first, so that the pad keeps its
    direction."""
    first = drives[jaw.joints[0]]
    sense = jaw.closes * float(np.sign(first.slope))
    factor = sense if jaw.slides else jaw.closes * first.slope
    begin = _open(first.servo, sense)
    factors, offset = {first.servo.index: factor}, -factor * begin
    for name, turn in zip(jaw.joints[1:], jaw.turns[1:], strict=True):
        drive = drives.get(name)
        if jaw.slides or drive is None or drive.servo.index in factors or abs(turn) < 0.9:
            continue
        against = -float(np.sign(turn)) * first.slope / drive.slope
        ends = np.array([begin, begin + sense * _way(first.servo)]) * against
        lower, upper = drive.servo.limits.lower or 0.0, drive.servo.limits.upper or 0.0
        if ends.min() >= lower - 1e-6 and ends.max() <= upper + 1e-6:
            factors[drive.servo.index] = factor * against
    total = len(factors)
    if total > 1:  # each of them moves by its own factor
        squares = sum(one**2 for one in factors.values()) / factor**2
        factors = {servo: one / squares for servo, one in factors.items()}
    return {servo: round(one, 9) for servo, one in factors.items()}, offset


def _way(servo: Servo) -> float:
    return (servo.limits.upper or 0.0) - (servo.limits.lower or 0.0)


def _open(servo: Servo, sense: float) -> float:
    """Angle [rad] of the servo with open jaws. They close with the sign `sense` of its motion."""
    return (servo.limits.lower if sense > 0.0 else servo.limits.upper) or 0.0


def _generic(
    id: int, name: str, draft: Robot, factors: Mapping[int, float], offset: float, shared: Mapping[int, int]
) -> GenericServo:
    """A generic joint of a jaw. At the start the jaw is open, 3 degrees from its limit."""
    if not factors:
        return GenericServo(id=id, name=name, servo=None)
    servo, factor = next(iter(factors.items()))
    initial = min(ROOM, 0.4 * abs(factor) * _way(draft.servos[servo]))
    if len(factors) == 1 and shared[servo] == 1:
        return generic_joint(id, name, servo, scale=factor, offset=offset, initial=initial)
    terms = tuple(Term(servo=servo, factor=factor) for servo, factor in factors.items())
    return generic_joint(id, name, servo, transform="synergy", terms=terms, offset=offset, initial=initial)


def _square(vector: Array, to: Array) -> Array:
    """Unit vector (3,) along the part of `vector` that is square to `to`."""
    out = to / np.linalg.norm(to)
    rest = vector - out * float(out @ vector)
    if np.linalg.norm(rest) < 1e-9:
        rest = np.cross(out, np.eye(3)[int(np.argmin(np.abs(out)))])
    unit: Array = rest / np.linalg.norm(rest)
    return unit


def _pad(
    name: str, part: GenericPart, segment: str, near: Array, out: Array, along: Array, points: LinkPoints
) -> list[Patch]:
    """A flat pad on the face of the points `near` (n, 3) [m] in the direction `out` (3,), with rows along
    `along` (3,); none if there are no points."""
    if not len(near):
        return []
    across = np.cross(out, along)
    places = near @ np.column_stack([along, across])
    cells = np.floor((places - places.min(axis=0)) / PITCH).astype(int)
    top: dict[tuple[int, ...], float] = {}
    for cell, height in zip(map(tuple, cells.tolist()), (near @ out).tolist(), strict=True):
        top[cell] = max(height, top.get(cell, -np.inf))
    height = float(np.quantile(list(top.values()), HIGH))
    flat = np.array([cell for cell, one in top.items() if one > height - FLAT])
    middle, sides = height * out, []
    for axis, begin, own in zip((along, across), places.min(axis=0), flat.T, strict=True):
        low, high = float(begin + own.min() * PITCH), float(begin + (own.max() + 1) * PITCH)
        middle = middle + axis * (low + high) / 2.0
        sides.append(float(np.clip(high - low, LEAST, LARGEST)))
    link = part.segment(segment).link
    R_RL, p_RL = points.link_pose(link)
    rows, columns = (max(2, round(side / PITCH)) for side in sides)
    pad = Grid(
        rows=rows, columns=columns, length=sides[0], width=sides[1],
        origin=three(R_RL.T @ (middle - p_RL)), rpy=rpy_of(R_RL.T @ np.column_stack([along, across, out])),
    )  # fmt: skip
    return [
        Patch(
            name=name, part=part.name, segment=segment, link=link, rate=100.0, channels=rows * columns,
            surface=pad, assumed=True,
            sensor=Sensor(rest=240.0, pascal_per_count=-600.0, lowest=0.0, highest=255.0),
        )
    ]  # fmt: skip
