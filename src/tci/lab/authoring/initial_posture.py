"""Proposes the initial posture of both arms: away from joint limits and from the body."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.joint_facts import RADIANS
from tci.messages.frames import Array
from tci.robot.collisions import MOST, NEAR, nearby, solid_spec
from tci.robot.description import GenericPart, Robot
from tci.robot.joint_map import JointMap, initial_position, joint_map
from tci.robot.model_file import compiled

POSTURES = np.deg2rad([[25, 25, 0, 60, 0], [25, 25, 0, 75, 0], [35, 30, 0, 60, 0], [20, 40, 0, 60, 0],
                       [40, 20, 10, 70, 0], [25, 15, -15, 50, 0], [15, 15, 0, 45, 0], [30, 45, 0, 75, 0],
                       [45, 45, 0, 60, 0], [30, 60, 0, 90, 0], [30, 45, 30, 75, 0]])  # fmt: skip
"""Candidates for the initial posture [rad]; the first posture that fits is used. All values are assumed."""
ALONE = np.deg2rad([[0, 30, 0, 60, 0], [0, 30, 0, 45, 0], [0, 45, 0, 75, 0], [0, 45, 0, 60, 0],
                    [0, 45, 0, 45, 0], [0, 60, 0, 75, 0], [0, 60, 0, 60, 0], [0, 60, 0, 90, 0],
                    [0, 60, 0, 105, 0], [0, 70, 0, 110, 0], [0, 75, 0, 120, 0], [30, 60, 0, 90, 0],
                    [0, 100, 0, 100, 0], [0, 110, 0, 130, 0], [0, 20, 0, 40, 0]])  # fmt: skip
"""Candidates for an arm that stands alone, as `POSTURES`: raised, with its forearm forward. The less raised
ones come first, since the pan takes an upper arm aside by the cosine of its lift. The yaw is +-90 degrees, as
far as the arm can choose it."""
WITHDRAWS = np.deg2rad([15.0, 15.0, 0.0, 15.0, 0.0])
"""How far [rad] the withdrawal reflex turns each joint of an arm that moves its skin, of those that all such
arms have."""
ROOM = 0.1
"""Distance [rad] from the joint limits that is sufficient for an initial posture."""
TURNED = float(np.deg2rad(120.0))
"""Largest rotation [rad] of a shoulder's joint from its rest (the model's zero, or the middle of its range).

This rotation counts as a limit of the joint. Otherwise an arm such as Baxter's, whose elbow bends down while
the arm points forward, would get a twisted posture.
"""


def candidates(part: GenericPart) -> Array:
    """Candidates (m, 5) [rad] for the initial posture of an arm."""
    if not part.stands_alone:
        return POSTURES
    yaw = part.servos[2].offset if part.servos[2].servo is not None else part.servos[2].fixed
    found = np.array(ALONE)
    found[:, 2] = yaw if part.servos[2].servo is None else np.pi / 2.0 * (1.0 if yaw >= 0.0 else -1.0)
    if yaw < 0.0:  # the elbow bends up
        found[:, 1] -= found[:, 3]
    return found


def with_initial(draft: Robot, part: GenericPart) -> GenericPart:
    """Returns the arm with an initial posture: the first candidate in which each servo is at least 0.1 rad
    from its limits.

    If there is none, uses the posture with the largest distance from limits. If this posture is beyond a
    limit, uses the nearest posture inside the limits.
    """
    robot = draft.model_copy(update={"parts": (part,), "digest": f"{part.name} {part.servos[3].scale}"})
    joints = joint_map(robot, part.name)
    start, (lower, upper) = np.zeros(len(draft.servos)), _limits(draft, joints)
    postures = candidates(part)
    rooms = [_room(draft, joints, posture) for posture in postures]
    best = postures[int(np.argmax(np.minimum(rooms, ROOM)))]
    if max(rooms) < 0.0:
        inside = np.array(start)
        inside[joints.servos] = np.clip(joints.to_robot(best, start), lower, upper)
        best = joints.to_generic(inside)
    return _placed(part, best)


def check_reach(draft: Robot, part: GenericPart) -> None:
    """Raises DescriptionError if each candidate for the initial posture (`POSTURES`) is at least 0.1 rad
    beyond a joint limit of the arm.

    In this case the limits in the model file are wrong.
    """
    robot = draft.model_copy(update={"parts": (part,), "digest": f"{part.name} reach"})
    joints = joint_map(robot, part.name)
    postures = candidates(part)
    rooms = [_room(draft, joints, posture, turned=np.inf) for posture in postures]
    if max(rooms) > -ROOM:
        return
    start, (lower, upper) = np.zeros(len(draft.servos)), _limits(draft, joints)
    angles = joints.to_robot(postures[int(np.argmax(rooms))], start)
    worst = int(np.argmax(np.maximum(lower - angles, angles - upper)))
    low, high, needed = np.rad2deg([lower[worst], upper[worst], angles[worst]])
    pose = "be raised from its base" if part.stands_alone else "hang down"
    radians = robot.model is not None and robot.model.format == "mjcf" and high - low < 4.0 * np.pi
    message = (
        f"{part.name}: the arm can't {pose} with its forearm forward; joint "
        f"{draft.servos[joints.servos[worst]].name} would need {needed:.0f} degrees, and its limits are "
        f"{low:.0f} to {high:.0f} degrees; valid: a model file with the right limits of this joint (not "
        "those of the other side or of another joint), in which the names left and right are not exchanged"
        + (f"; {RADIANS}" if radians else "")
    )
    raise DescriptionError(draft.source, [Fault(0, message)])


def clear_of_body(draft: Robot, arms: Sequence[GenericPart]) -> list[GenericPart]:
    """Returns both arms in the posture with the largest distances between links.

    Candidates are the given posture and all of POSTURES that are far enough from joint limits. If no links
    are near each other, the arms are returned unchanged. Pairs of links that overlap in most postures overlap
    by construction; their overlap is not counted.
    """
    robot = draft.model_copy(update={"parts": tuple(arms), "digest": "clear of body"})
    assert robot.model is not None
    model = compiled(solid_spec(robot, mimics=False), robot.model)

    def distances(posed: Sequence[GenericPart]) -> dict[tuple[int, int], float]:
        parts = {"parts": tuple(posed), "digest": f"{posed[0].initial_posture}"}
        return nearby(model, robot, initial_position(robot.model_copy(update=parts)), within=NEAR)

    found = [(list(arms), distances(arms))]
    joints = [joint_map(robot, part.name) for part in arms]
    for posture in candidates(arms[0]) if found[0][1] else ():
        if min(_room(draft, one, posture) for one in joints) >= ROOM:
            posed = [_placed(part, posture) for part in arms]
            found.append((posed, distances(posed)))
    overlaps = Counter(pair for _, near in found for pair, distance in near.items() if distance <= 0.0)
    built = {pair for pair, count in overlaps.items() if count > len(found) / 2.0}
    costs = [
        sum(NEAR - distance for pair, distance in near.items() if distance > 0.0 or pair not in built)
        for _, near in found
    ]
    return found[int(np.argmin(costs))][0]


def clear_to_withdraw(draft: Robot, arm: GenericPart) -> GenericPart:
    """Returns an arm that stands alone in the first posture from which no joint that withdraws brings links
    near each other or near what carries the arm; if there is none, in that in which they come least near.

    Links that are near each other after nearly all withdrawals are near by construction. Jaws are as in the
    model's zero.
    """
    robot = draft.model_copy(update={"parts": (arm,), "digest": "clear to withdraw"})
    assert robot.model is not None
    model = compiled(solid_spec(robot, mimics=False), robot.model)
    joints, (lower, upper) = joint_map(robot, arm.name), _limits(draft, joint_map(robot, arm.name))
    found: list[tuple[Array, list[dict[tuple[int, int], float]]]] = []
    for posture in candidates(arm):
        if _room(draft, joints, posture) < ROOM:
            continue
        after = []
        for way in np.vstack([np.zeros(len(posture)), *(sign * np.diag(WITHDRAWS) for sign in (-1.0, 1.0))]):
            there, position = posture + way, np.zeros(len(draft.servos))
            position[joints.servos] = np.clip(joints.to_robot(there, position), lower, upper)
            after.append(nearby(model, robot, position, within=NEAR))
        found.append((posture, after))
    if not found:
        return arm
    ends = [near for _, after in found for near in after]
    counts = Counter(pair for near in ends for pair in near)
    built = {pair for pair, count in counts.items() if count >= MOST * len(ends)}
    costs = [
        max(sum(NEAR - near[pair] for pair in near.keys() - built) for near in after) for _, after in found
    ]
    return _placed(arm, found[int(np.argmin(costs))][0])


def _room(draft: Robot, joints: JointMap, posture: Array, *, turned: float = TURNED) -> float:
    """Returns the distance [rad] of an arm's servos from the nearest limit in a posture, negative beyond the
    limit.

    A shoulder joint is also limited to `turned` [rad] from its rest, which is the nearer of the model's zero
    and the middle of the joint's range. If the servos can't reach the posture, the result is much lower.
    """
    start, (lower, upper) = np.zeros(len(draft.servos)), _limits(draft, joints)
    angles = joints.to_robot(posture, start)
    there = np.array(start)
    there[joints.servos] = angles
    missed = np.abs(joints.to_generic(there) - posture)[joints.ids].max()
    turn = np.minimum(np.abs(angles), np.abs(angles - (lower + upper) / 2.0))[joints.ids < 3].max()
    return float(min((angles - lower).min(), (upper - angles).min(), turned - turn) - 10.0 * missed)


def _limits(draft: Robot, joints: JointMap) -> Array:
    """Returns the lower and upper limits (2, k) [rad] of an arm's servos."""
    limits = [draft.servos[servo].limits for servo in joints.servos]
    return np.array([[limit.lower, limit.upper] for limit in limits], dtype=float).T


def _placed(part: GenericPart, posture: Array) -> GenericPart:
    servos = [j.model_copy(update={"initial": float(a)}) for j, a in zip(part.servos, posture, strict=True)]
    return part.model_copy(update={"servos": tuple(servos)})
