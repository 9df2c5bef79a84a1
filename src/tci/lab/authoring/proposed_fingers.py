"""Proposes the generic fingers of a hand: motors and joints of each finger, their coupling, and its tip."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_fingers import ROUNDED, DoubtfulFingersError, Finger, find_fingers
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.joint_facts import RADIANS, JointFacts
from tci.lab.authoring.joint_tree import carried
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_parts import ROOM, generic_joint, segment
from tci.messages.frames import Array
from tci.robot.description import GenericPart, GenericServo, Mimic, Robot, Servo
from tci.robot.description.part import Term
from tci.robot.generic_arm import Side
from tci.robot.generic_fingers import JOINTS, PALM

Trust = Literal["names", "places", "none"]
"""Rule for hands whose fingers have names that contradict their places. "names": the names decide. "places":
the places decide. "none": every hand is described without fingers."""
SHORTEST = 0.005
"""Least plausible length [m] of a finger's last link. If the geometry of the link gives a shorter length,
this length is not used. Assumed: shorter than any finger tip."""
Hands = Mapping[Side, tuple[Finger, ...]]
"""Fingers by side. Hands without fingers are left out."""


class _Drive(NamedTuple):
    """Servo that moves a joint: joint angle = `multiplier` * servo angle + `offset`."""

    servo: Servo
    multiplier: float
    offset: float


def find_hands(
    body: FoundLimbs, facts: Mapping[str, JointFacts], points: LinkPoints, path: str, *, trust: Trust | None
) -> Hands:
    """Returns the fingers of both hands. `trust` decides if names and places of fingers contradict each
    other. Raises DescriptionError if the fingers of a hand can't be identified; its advice has the values of
    `trust` with which they can."""
    ends = {name: _tips(body, start, points) for name, start in _starts(body).items()}
    try:
        return _alike(_find(body, facts, ends, trust))
    except _DoubtfulHandError as doubt:
        able = [one for one in get_args(Trust) if _finds(body, facts, ends, one)]
        if body.hand is not None:  # without fingers, nothing would be left of it
            ways = [f"--fingers {one}" for one in able if one != "none"]
            ways += [RADIANS] * doubt.hardly_bends
            valid = "a model whose joints bend each finger farther to the palm than back"
            message = f"{doubt}; valid: {' or '.join([*ways, valid])}"
        else:
            message = f"{doubt}; valid: {' or '.join(f'--fingers {one}' for one in able)}"
            message += " (hands without fingers)"
        raise DescriptionError(path, [Fault(0, message)]) from None


class _DoubtfulHandError(Exception):
    """Fingers of one hand that can't be identified."""

    def __init__(self, side: Side, doubt: DoubtfulFingersError) -> None:
        super().__init__(f"fingers of the {side} hand: {doubt}")
        self.hardly_bends = doubt.hardly_bends


def _find(
    body: FoundLimbs, facts: Mapping[str, JointFacts], ends: Mapping[Side, Mapping[int, Array]],
    trust: Trust | None,
) -> Hands:  # fmt: skip
    hands: dict[Side, tuple[Finger, ...]] = {}
    for side, start in _starts(body).items() if trust != "none" else ():
        try:
            found = find_fingers(body.joints, start, side, facts, ends[side], trust=trust)
        except DoubtfulFingersError as doubt:
            raise _DoubtfulHandError(side, doubt) from None
        if found:
            hands[side] = found
    return hands


def _starts(body: FoundLimbs) -> dict[Side, int | None]:
    """By side, the joint that carries the hand; None for a hand that is alone."""
    if body.hand is not None:
        return {body.hand: None}
    return {"left" if name == "left" else "right": limb.bend for name, limb in body.arms.items()}


def palm_of(body: FoundLimbs, finger: Finger, points: LinkPoints) -> tuple[str, Array]:
    """The link that carries the fingers, and a point (3,) [m] where it begins, in the frame H."""
    parent = body.joints[finger.chain[0]].parent
    if parent >= 0:
        return body.joints[parent].link, body.joints[parent].anchor
    return body.torso_link, points.link_pose(body.torso_link)[1] @ body.R_RH


def _finds(
    body: FoundLimbs, facts: Mapping[str, JointFacts], ends: Mapping[Side, Mapping[int, Array]], trust: Trust
) -> bool:
    try:
        _find(body, facts, ends, trust)
    except _DoubtfulHandError:
        return False
    return True


def _alike(hands: Hands) -> Hands:
    """Gives both thumbs the opposition angle of the first hand, if their angles at the model's zero differ by
    at most one rounding step (15 degrees).
    """
    thumbs = [found[0].offset for found in hands.values() if found[0].name == "thumb"]
    if len(thumbs) < 2 or abs(thumbs[0] - thumbs[1]) > 1.01 * ROUNDED:
        return hands
    return {side: (replace(found[0], offset=thumbs[0]), *found[1:]) for side, found in hands.items()}


def with_followers(
    servos: Sequence[Servo], body: FoundLimbs, facts: Mapping[str, JointFacts], hands: Hands
) -> tuple[Servo, ...]:
    """Returns the servos, each with the finger joints that follow it mechanically."""
    own = {servo.joint: servo for servo in servos}
    followers: dict[int, list[Mimic]] = {}
    for one in (one for found in hands.values() for finger in found for one in finger.chain):
        name = body.joints[one].name
        if name not in own and (drive := _drive(name, own, facts)) is not None:
            mimic = Mimic(joint=name, multiplier=drive.multiplier, offset=drive.offset)
            followers.setdefault(drive.servo.index, []).append(mimic)
    return tuple(
        servo.model_copy(update={"mimics": tuple(followers.get(servo.index, ()))}) for servo in servos
    )


def fingers(
    draft: Robot, body: FoundLimbs, side: Side, found: Sequence[Finger], facts: Mapping[str, JointFacts],
    points: LinkPoints,
) -> GenericPart:  # fmt: skip
    """Returns the generic fingers of one hand."""
    own = {servo.joint: servo for servo in draft.servos}
    rows: dict[str, tuple[dict[int, float], float]] = {}
    segments = []
    for finger in found:
        drives = {one: _drive(body.joints[one].name, own, facts) for one in finger.chain}
        bends = [(sign, drives[one]) for one, sign in zip(finger.flexion, finger.signs, strict=True)]
        rows[f"{finger.name}_flexion"] = _flexion(
            [(sign, drive) for sign, drive in bends if drive is not None]
        )
        turn = None if finger.spread is None else drives[finger.spread]
        if turn is not None:
            factor = {turn.servo.index: finger.outward * turn.multiplier}
            rows[f"{finger.name}_spread"] = factor, finger.outward * turn.offset + finger.offset
        link, start = body.joints[finger.chain[-1]].link, body.joints[finger.flexion[-1]].anchor
        segments.append(segment(body, points, finger.name, link, start, finger.tip))
    palm, wrist = palm_of(body, found[0], points)
    bases = np.mean([body.joints[finger.flexion[0]].anchor for finger in found], axis=0)
    segments.append(segment(body, points, PALM, palm, wrist, bases))
    shared = Counter(servo for factors, _ in rows.values() for servo in factors)
    servos = tuple(
        _generic(draft, id, name, *rows.get(name, ({}, 0.0)), shared) for id, name in enumerate(JOINTS)
    )
    return GenericPart(
        name=f"{side}_fingers", kind="fingers", side=side, servos=servos, segments=tuple(segments)
    )


def _tips(body: FoundLimbs, arm: int | None, points: LinkPoints) -> dict[int, Array]:
    """Returns the end (3,) [m] of each link that the joint `arm` carries, or of all (None), by the index of
    the joint that moves this link. The ends are in the frame H: x forward, y left, z up.

    The end is the place of the next joint, or else the far end of the link's geometry. If there is neither,
    the link is assumed to be as long as the previous link.
    """
    ends = {}
    for one in range(len(body.joints)) if arm is None else carried(body.joints, arm):
        joint = body.joints[one]
        after = [other.anchor for other in body.joints if other.parent == one]
        end = points.far_end(joint.link, body.R_RH @ joint.anchor)
        before = body.joints[joint.parent].anchor if joint.parent >= 0 else joint.anchor
        last = 2.0 * joint.anchor - before
        if end is not None and np.linalg.norm(end @ body.R_RH - joint.anchor) > SHORTEST:
            last = end @ body.R_RH
        ends[one] = after[0] if after else last
    return ends


def _drive(name: str, own: Mapping[str | None, Servo], facts: Mapping[str, JointFacts]) -> _Drive | None:
    """Returns the servo that moves the joint `name`, by itself or through a joint that this joint follows
    mechanically; None if no servo moves the joint."""
    multiplier, offset = 1.0, 0.0
    while name not in own:
        given = facts.get(name)
        if given is None or not given.follows:
            return None
        multiplier, offset = multiplier * given.multiplier, offset + multiplier * given.offset
        name = given.follows
    return _Drive(own[name], multiplier, offset)


def _flexion(bends: Sequence[tuple[float, _Drive]]) -> tuple[dict[int, float], float]:
    """Returns factors by servo index, and an offset [rad]: a finger's flexion [rad] is the sum of factor *
    servo angle, plus the offset.

    The flexion is the angle of the finger's first bending joint. If the finger has several motors, they are
    assumed to move in the ratio of their ranges.
    """
    if not bends:
        return {}, 0.0
    ranges: dict[int, tuple[float, float]] = {}
    for sign, drive in bends:
        limits = drive.servo.limits
        slope = sign * drive.multiplier
        reach = max(slope * (limits.lower or 0.0), slope * (limits.upper or 0.0))
        ranges.setdefault(drive.servo.index, (slope, reach))
    able = {servo: one for servo, one in ranges.items() if one[1] > 0.0}
    ranges = able or ranges  # a joint that is at its bent end at the model's zero stays there
    first = next(iter(ranges.values()))[1]
    turn = {servo: reach / first / slope for servo, (slope, reach) in ranges.items()}
    total = sum(angle**2 for angle in turn.values())
    offset = bends[0][0] * bends[0][1].offset if len(turn) == 1 else 0.0
    return {servo: round(angle / total, 9) for servo, angle in turn.items()}, offset


def _generic(
    draft: Robot, id: int, name: str, factors: Mapping[int, float], offset: float, shared: Mapping[int, int]
) -> GenericServo:
    """Returns a generic joint of a finger, whose angle is the sum of factor * servo angle, plus `offset`
    [rad].

    `factors` are by servo index. `shared` is the number of generic joints that a servo moves, by servo index.
    """
    if not factors:
        return GenericServo(id=id, name=name, servo=None)
    zero = {servo: _near_zero(draft.servos[servo]) for servo in factors}
    initial = offset + sum(factor * zero[servo] for servo, factor in factors.items())
    servo, factor = next(iter(factors.items()))
    if len(factors) == 1 and shared[servo] == 1:
        return generic_joint(id, name, servo, scale=factor, offset=offset, initial=initial)
    terms = tuple(Term(servo=servo, factor=factor) for servo, factor in factors.items())
    return generic_joint(id, name, servo, transform="synergy", terms=terms, offset=offset, initial=initial)


def _near_zero(servo: Servo) -> float:
    """Returns the servo angle [rad] nearest to 0 that is at least 3 degrees from both limits, or 0.4 of the
    servo's range if that is less."""
    lower, upper = servo.limits.lower or 0.0, servo.limits.upper or 0.0
    room = min(ROOM, 0.4 * (upper - lower))
    return float(np.clip(0.0, lower + room, upper - room))
