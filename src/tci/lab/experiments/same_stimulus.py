"""Compares the responses of several robots to one touch of the generic limb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.places import find_place
from tci.body.posture import to_platform
from tci.capabilities.fields import ReceptiveField
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import Contact, Contacts, GenericCommand, JointReading, Mode, Perception, Site
from tci.messages.frames import Array, angle_between, apply, invert, read_only
from tci.robot.description import Robot
from tci.robot.generic_arm import limb_coordinates
from tci.robot.joint_map import generic_posture, initial_position
from tci.skin.contacts import single_contact

FORCES = np.linspace(0.0, 2.0, 5)
"""Force [N] of the stimulus in successive frames (frames,). Assumed: a touch whose force rises within 50 ms,
up to the force of a full response. The first force above 0 is 0.5 N, because with less force the reflex would
respond only on long arms: a short arm would move by less than the 1 mm that the reflex requires."""


@dataclass(frozen=True, slots=True)
class SameStimulus:
    """Differences between the responses of several robots to one stimulus."""

    max_generic_difference_rad: float
    """Largest difference [rad] between the generic targets of two robots, over all touched receptive fields,
    both arms and all forces of the touch."""
    hand_direction_deg: dict[str, float]
    """Largest angle [degrees] between the displacements of two robots' hands, by name of the touched
    receptive field. Displacements are relative to the shoulder, where the upper arm begins, in the axes of
    the arm's mount frame."""
    hand_direction_torso_deg: dict[str, float]
    """Largest angle [degrees] between the displacements of two robots' hands, by name of the touched
    receptive field. Displacements are relative to the torso and include the motion of the shoulder."""


def same_stimulus(bodies: Sequence[GenericBody], fields: Sequence[ReceptiveField]) -> SameStimulus:
    """Applies the same touch (u, theta, force) to each robot's skin, and compares the commands of the reflex.

    The touch is converted to a point on the robot's skin, and this point is converted back to (u, theta) with
    the robot's kinematics. So the comparison includes the model, the mounts and the joint map of each robot.
    """
    difference, directions = 0.0, {}
    for field in fields:
        angles = np.zeros(2)
        for side in ("left", "right"):
            answers = [answer(body, f"{side}_arm", field) for body in bodies]
            spread = (float(np.ptp(goals, axis=0).max()) for goals in zip(*answers, strict=True))
            difference = max(difference, max(spread, default=0.0))
            moved = [displacements(b, f"{side}_arm", a[-1]) for b, a in zip(bodies, answers, strict=True)]
            for one, other in combinations(moved, 2):
                apart = [float(np.rad2deg(angle_between(*pair))) for pair in zip(one, other, strict=True)]
                angles = np.maximum(angles, apart)
        directions[field.name] = angles.tolist()
    return SameStimulus(
        max_generic_difference_rad=difference,
        hand_direction_deg={name: shoulder for name, (shoulder, _) in directions.items()},
        hand_direction_torso_deg={name: torso for name, (_, torso) in directions.items()},
    )


def answer(body: GenericBody, part: str, field: ReceptiveField) -> Array:
    """Returns the generic targets (frames, 5) [rad] of the reflex while the force at the centre of `field`
    increases."""
    reflex = WithdrawalReflex()
    memory = reflex.init(body)
    joints = initial_joints(body.robot)
    posture = body.posture(joints)
    target, targets = posture[part], []
    for sequence, force in enumerate(FORCES):
        contact = touch(body, part, field, joints, force=float(force), sequence=sequence)
        perception = Perception(contact.stamp, posture, Contacts.of((contact,)), joints=joints)
        commands, memory = reflex.step(memory, perception, body)
        for command in commands:
            if isinstance(command, GenericCommand):
                target = command.values
        targets.append(target)
    return read_only(targets)


def initial_joints(robot: Robot) -> JointReading:
    """Returns the reading of a robot at rest in its initial posture."""
    still = read_only(np.zeros(len(robot.servos)))
    return JointReading(0.0, 0, initial_position(robot), still)


def touch(
    body: GenericBody, part: str, field: ReceptiveField, joints: JointReading, *, force: float, sequence: int
) -> Contact:
    """Returns a contact of one taxel with the force `force` [N] at the centre of `field`, on the robot's
    skin."""
    robot, skin = body.robot, body.skin
    generic_part = robot.part(part)
    assert generic_part.side is not None
    place = find_place(skin, part, field.segment, field.u, field.theta, joints)
    T_TL = skin.link_pose(robot.patch(place.patch).link, joints)
    posture = generic_posture(robot, joints)[part]
    T_TS = skin.segment_pose(part, field.segment, joints, posture)
    p_T = apply(T_TL, place.p_L)
    length = generic_part.segment(field.segment).length
    u, theta = limb_coordinates(apply(invert(T_TS), p_T), length, generic_part.side)
    n_T = T_TL[:3, :3] @ place.n_L
    return single_contact(
        Site(place.patch, part, field.segment), [0], [force],
        stamp=0.01 * sequence, sequence=sequence, u=float(u), theta=float(theta), taxel_u=[u],
        taxel_theta=[theta], p_L=place.p_L, n_L=place.n_L, p_T=p_T, n_T=n_T, f_T=-force * n_T,
    )  # fmt: skip


def displacements(body: GenericBody, part: str, target: Array) -> Array:
    """Returns the displacements (2, 3) [m] of the forearm's distal end from the initial posture to `target`.

    The first row is relative to the proximal end of the upper arm, and the second row to the torso. Both rows
    have the axes of the arm's mount frame. The rows differ if the shoulder's axes do not intersect, because
    the upper arm's proximal end then moves too.
    """
    start = initial_joints(body.robot)
    command = to_platform(body.robot, GenericCommand(part, Mode.POSITION, target))
    position = np.array(start.position)
    position[command.servos] = command.values
    end = JointReading(0.0, 1, read_only(position), start.velocity)
    generic_part = body.robot.part(part)
    tip_S = np.array([0.0, 0.0, -generic_part.segment("forearm").length])
    seen = []
    for joints in (start, end):
        posture = generic_posture(body.robot, joints)[part]
        shoulder = body.skin.segment_pose(part, "upper_arm", joints, posture)[:3, 3]
        tip = apply(body.skin.segment_pose(part, "forearm", joints, posture), tip_S)
        seen.append([tip - shoulder, tip])
    displacement: Array = (np.array(seen[1]) - seen[0]) @ generic_part.R_TM
    return displacement
