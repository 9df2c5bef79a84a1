"""Proposes a description of a robot with two arms, or of one arm or hand, from its URDF or MJCF alone.

The arms are found by geometry, which must fit the definition of the generic arm. Limits are copied from the
file. Pads that the model has become its skin; without any, sleeves of skin are fitted to the geometry of the
links. If the file lacks a value, this module proposes a value and marks it as assumed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.assumed_limits import mended, twins_of
from tci.lab.authoring.find_arm import find_arm
from tci.lab.authoring.find_hand import find_hand
from tci.lab.authoring.find_jaws import Gripper, find_gripper, lone_gripper
from tci.lab.authoring.find_limbs import FoundLimbs, NoPairError, find_limbs
from tci.lab.authoring.find_pads import Pad
from tci.lab.authoring.hand_skin import hand_skin
from tci.lab.authoring.initial_posture import check_reach, clear_of_body, clear_to_withdraw
from tci.lab.authoring.joint_facts import (
    FINGER_TORQUE,
    SLOWEST,
    TORQUE,
    JointFacts,
    borne,
    driven,
    proposed_limits,
    read_facts,
)
from tci.lab.authoring.joint_tree import ancestors
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.pad_patches import pad_patches
from tci.lab.authoring.proposed_arm import Sign, arm, elbow_senses
from tci.lab.authoring.proposed_fingers import Hands, Trust, find_hands, fingers, with_followers
from tci.lab.authoring.proposed_gripper import gripper_servos, jaw_pads, jaws
from tci.lab.authoring.proposed_lone_arm import lone_arm
from tci.lab.authoring.proposed_parts import hand, leg, middle, wrist
from tci.lab.authoring.sleeves import sleeves
from tci.messages import Mode
from tci.messages.frames import rpy_of
from tci.robot.description import GenericPart, Model, Mount, Patch, Robot, Servo
from tci.robot.generic_arm import Side
from tci.robot.model_format import model_format


def propose(
    path: Path, *, name: str, package: str | None = None, linear: bool = False,
    meshes: str | None = None, radians: bool = False, arms: tuple[str, ...] | None = None,
    elbow: Sign | None = None,
    trust_fingers: Trust | None = None, skin_on_hands: bool = False, pads: Sequence[Pad] = (),
    cover: bool | None = None, side: Side = "left", mount: Mount | None = None, forward: str | None = None,
) -> Robot:  # fmt: skip
    """Proposes the description of the robot whose URDF or MJCF is at `path`, for review by a person.

    Args: path: URDF or MJCF file. name: Name of the robot. package: Installed Python package that contains
        the model. linear: Matters only for a shoulder whose axes are slightly rotated against those of the
        generic shoulder. True: the description has a rotated mount frame, if eq. 1 is exact in this frame.
        False: the shoulder is retargeted in the torso frame. meshes: Folder with the meshes, if they are not
        at the paths in the model; "none" to do without meshes. radians: The angles of an MJCF that tells no
        unit are in radians. arms: Names of the first joints of the left
        and the right shoulder, if the arms are in doubt; one name for an arm alone. elbow: Direction in which
        the left elbow's joint bends the arm, if it is in doubt. trust_fingers: "names" or "places": source to
        trust if the names and the places of the fingers contradict each other; "none" describes the hands
        without fingers.
        skin_on_hands: Adds assumed skin on palms and finger tips. pads: Pads of the model. cover: True: adds
        sleeves of skin around the arms, although no model shows them; False: adds none; None: adds them if
        there are no `pads`. side, mount, forward: As what one arm alone counts, what it is mounted on, and
        the axis of the model's root that points forward; see `find_arm`.

    Raises DescriptionError for a file that is not a model of a robot with one arm or two, or if arms, elbows,
    the ends of forearms or fingers are in doubt.
    """
    model = Model(
        format=model_format(path), path=str(path.resolve()), package=package, meshes=meshes, radians=radians,
        torso_link="?",
    )  # fmt: skip
    points = LinkPoints(model)
    body = _body(model, points, arms, side=side, mount=mount, forward=forward)
    rpy, xyz = rpy_of(body.T_ET[:3, :3]), body.T_ET[:3, 3]
    frame: dict[str, object] = {
        "torso_link": body.torso_link,
        "torso_rpy": tuple(round(float(angle), 9) for angle in rpy),
        "torso_xyz": tuple(round(float(place), 6) for place in xyz),
    }
    if body.mounted is not None:
        frame |= {"stands_on": body.mounted[0], "stands_at": round(body.mounted[1], 6)}
    model = model.model_copy(update=frame)
    facts = mended(read_facts(model, points.compiled), twins_of(body) if body.is_humanoid else {})
    hands = find_hands(body, facts, points, str(path), trust=trust_fingers)
    gripper = None if hands or trust_fingers == "none" else _gripper(body, facts, points)
    servos = with_followers(_servos(body, facts, points, hands, gripper), body, facts, hands)
    if gripper is not None:
        servos += gripper_servos(gripper, facts, points, _own_side(body), first=len(servos))
    index = {servo.joint: servo.index for servo in servos}
    _check_arms(body, servos, points, str(path))
    draft = Robot(
        name=name, title=f"{name}, proposed from {path.name}", source=str(path), digest="", model=model,
        servos=servos, parts=(),
    )  # fmt: skip
    parts: list[GenericPart] = []
    patches: list[Patch] = []
    if body.is_humanoid:
        senses = elbow_senses(draft, body, points, index, left=elbow)
        parts += [
            arm(draft, body, _side(name), points, index, sense=senses[name], mount=linear)
            for name in body.arms
        ]
    elif body.arms:
        parts.append(lone_arm(draft, body, points, index, elbow=elbow))
    for made, limb in zip(parts, body.arms.values(), strict=True):
        check_reach(draft, made)
        if cover or (cover is None and not pads):
            patches += sleeves(body, limb, made, points)
    if body.is_humanoid:
        parts = clear_of_body(draft, parts)
    elif body.arms:
        parts = [clear_to_withdraw(draft, parts[0])]
    if body.is_humanoid or body.head:
        parts.append(middle(body, "head", body.head, index))
    if body.is_humanoid:
        parts.append(middle(body, "torso", body.trunk, index, sense=-1.0 if body.trunk_below else 1.0))
    wrists = [
        hand(draft, body, limb, arm, index) for limb, arm in zip(body.arms.values(), parts, strict=False)
    ]
    parts += [one for one in wrists if one is not None]
    for own, found in hands.items():
        parts.append(fingers(draft, body, own, found, facts, points))
        bare = body.hand is not None and not pads and cover is not False
        patches += hand_skin(body, found, parts[-1], points) if skin_on_hands or bare else []
    if gripper is not None:
        parts.append(jaws(draft, body, gripper, points, _own_side(body)))
        bare = body.hand is not None and not pads and cover is not False
        patches += jaw_pads(gripper, parts[-1], points) if skin_on_hands or bare else []
    parts += [leg(draft, body, one, own, points, index) for own, one in body.legs.items()]
    patches += pad_patches(draft, parts, pads, points.compiled)
    return draft.model_copy(update={"parts": tuple(parts), "patches": tuple(patches)})


def _body(
    model: Model,
    points: LinkPoints,
    arms: tuple[str, ...] | None,
    *,
    side: Side,
    mount: Mount | None,
    forward: str | None,
) -> FoundLimbs:
    """The humanoid in a model, or else its one hand or arm."""
    alone = partial(find_arm, model, points, side=side, mount=mount, forward=forward)
    if arms is not None and len(arms) == 1:
        return alone(first=arms[0])
    try:
        return find_limbs(model, points, arms=None if arms is None else (arms[0], arms[1]))
    except NoPairError:
        if (found := find_hand(model, side)) is not None:
            return found
        gripper = find_gripper(points, read_facts(model, points.compiled), None)
        return alone() if gripper is None else lone_gripper(gripper, points, side)


def _gripper(body: FoundLimbs, facts: Mapping[str, JointFacts], points: LinkPoints) -> Gripper | None:
    """The gripper of one arm, or one that is alone. Those of humanoids stay at zero."""
    if body.is_humanoid:
        return None
    behind = next((body.joints[limb.bend].link for limb in body.arms.values()), None)
    return find_gripper(points, facts, behind)


def _own_side(body: FoundLimbs) -> Side:
    return body.hand or _side(next(iter(body.arms)))


def _check_arms(body: FoundLimbs, servos: Iterable[Servo], points: LinkPoints, path: str) -> None:
    """Raises DescriptionError if a joint of an arm has no motor of its own, or too little torque to move the
    arm."""
    own = {servo.joint: servo for servo in servos}
    for limb in body.arms.values():
        for joint in (*limb.ball, limb.bend, *([] if limb.turn is None else [limb.turn])):
            name = body.joints[joint].name
            if name not in own:
                message = f"{name} of an arm follows another joint; valid: a joint with a motor of its own"
                raise DescriptionError(path, [Fault(0, message)])
            torque, inertia = own[name].limits.torque or 0.0, float(points.inertia([name])[0])
            if torque < SLOWEST * inertia:
                link, mass, own_inertia = points.most_inert(name)
                message = (
                    f"{name}: its torque of {torque:.3g} N m can't move the {inertia:.3g} kg m2 that it "
                    f"carries, such as link {link} of {mass:.3g} kg and {own_inertia:.3g} kg m2; valid: at "
                    f"least {SLOWEST * inertia:.3g} N m, or links whose mass and inertia are in kg and kg m2"
                )
                raise DescriptionError(path, [Fault(0, message)])


def _servos(
    body: FoundLimbs, facts: Mapping[str, JointFacts], points: LinkPoints, hands: Hands,
    gripper: Gripper | None,
) -> tuple[Servo, ...]:  # fmt: skip
    """Returns a servo for each actuated joint, in this order: torso, head, arms, legs, other joints. Those
    of a gripper are left out."""
    needed = {*body.trunk, *body.head, *(joint for leg in body.legs.values() for joint in leg.chain)}
    for limb in body.arms.values():
        needed |= {*limb.ball, limb.bend, *wrist(body, limb), *([] if limb.turn is None else [limb.turn])}
    able = driven(body.joints, facts, needed)
    on_head = [one for one in body.devices if set(body.head) & set(ancestors(body.joints, one))]
    groups: dict[str, Iterable[int]] = {"torso": body.trunk[::-1], "head": [*body.head, *on_head]}
    first = _first if body.is_humanoid else _own
    if body.hand is not None:
        groups[f"{body.hand}_hand"] = range(len(body.joints))
    groups |= {f"{side}_arm": body.behind(first(body, limb.ball[0])) for side, limb in body.arms.items()}
    groups |= {f"{side}_leg": body.behind(found.chain[0]) for side, found in body.legs.items()}
    named = {joint for group in groups.values() for joint in group}
    groups["other"] = [joint for joint in range(len(body.joints)) if joint not in named]
    reactions = points.reactions([joint.name for joint in body.joints])
    of_fingers = {joint for found in hands.values() for finger in found for joint in finger.chain}
    jawed = () if gripper is None else gripper.joints
    of_gripper = {one for one, joint in enumerate(body.joints) if joint.name in jawed}
    servos: list[Servo] = []
    for part, joints in groups.items():
        for id, joint in enumerate(joint for joint in joints if joint in able - of_gripper):
            name = body.joints[joint].name
            servos.append(
                Servo(
                    index=len(servos), robot_part=part, id=id, name=name, joint=name,
                    limits=proposed_limits(
                        facts[name], float(reactions[joint, joint]),
                        motor=FINGER_TORQUE if joint in of_fingers else TORQUE,
                    ),
                    modes=(Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE),
                )
            )  # fmt: skip
    return tuple(servos) if body.is_humanoid else borne(servos, body.joints, reactions)


def _side(name: str) -> Side:
    return "left" if name == "left" else "right"


def _own(_: FoundLimbs, shoulder: int) -> int:
    return shoulder


def _first(body: FoundLimbs, shoulder: int) -> int:
    """Returns the joint at which an arm begins: the joint `shoulder`, or the joint of a collar bone that
    carries the shoulder and no other limb."""
    joint = shoulder
    others = {limb.ball[0] for limb in body.arms.values()} | {leg.chain[0] for leg in body.legs.values()}
    while (parent := body.joints[joint].parent) >= 0 and len(others & set(body.behind(parent))) == 1:
        if parent in body.trunk:
            break
        joint = parent
    return joint
