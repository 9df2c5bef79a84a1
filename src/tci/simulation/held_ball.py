"""Finds a ball that the fingers of a hand can close around.

The module computes the ball's size and its position on the palm by kinematics.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array, apply, invert, read_only
from tci.robot.description import Robot
from tci.robot.generic_fingers import FINGERS, FLEXIONS, PALM
from tci.robot.joint_map import JointMap, joint_map
from tci.robot.kinematics import KinematicChain
from tci.simulation.world import MAX_TIP, start_angles
from tci.skin.surfaces import Surface, surfaces_of

RADII = np.geomspace(0.008, MAX_TIP, 9)
"""Radii [m] of balls that are tried, from the radius of a grape to the radius of an apple."""
BENDS = np.deg2rad(np.arange(0.0, 85.1, 2.5))
"""Flexions [rad] at which fingers are examined, up to the largest flexion in a light grasp."""
SINKS = 0.003
"""Least depth [m] to which a finger must be able to reach into the ball. Assumed: with a smaller depth the
finger would only touch the ball without pressing."""
FACES = 0.5
"""Least cosine of the angle between the outward normal of a fingertip that holds the ball and the direction
to the ball's centre. Assumed: the skin of a fingertip measures only a small force if the ball is beside the
fingertip."""
LIFTS = 0.4
"""Largest cosine of the angle between the push of a finger and the outward normal of the palm. Assumed: a
finger with a larger cosine would push the ball out of the hand."""
CLEAR = 0.006
"""Least distance [m] of each finger from the ball at the start. Assumed: the ball then has room on its way to
the palm."""
WAY = 0.012
"""Length [m] of the path on which the ball moves to the palm."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldBall:
    """A ball on a palm, and the fingers that touch the ball when the hand closes."""

    patch: str
    """Name of the palm's patch."""
    taxel: int
    """Index of the palm's taxel under the ball."""
    radius: float
    """Radius [m]."""
    fingers: tuple[str, ...]
    """Names of the fingers that touch the ball."""
    posture: Array
    """Generic angles (10,) [rad] of the hand just before the fingers touch the ball."""


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """Positions of one finger's k taxels at b successive moments while the hand closes, in the frame of
    the palm's link."""

    angles: Array
    """Flexions (b,) [rad] of the finger at b moments while the hand closes."""
    positions: Array
    """Positions (b, k, 3) [m] of the k taxels at the b moments."""
    normals: Array
    """Outward unit normals (b, k, 3) of the taxels."""


@dataclass(frozen=True, slots=True)
class _Meeting:
    """Contact between a ball and a finger that bends towards the ball."""

    start: float
    """Flexion [rad] at which the finger waits without touching the ball."""
    faces: float
    """Measure (up to 1) of the hold that the finger gives the ball; 0 for a finger that can't hold the ball.
    It is the cosine of the angle between the skin's outward normal and the direction to the ball's centre, at
    the first contact. If the finger pushes the ball out of the palm, the cosine of the angle between this
    push and the palm's outward normal is subtracted."""


def held_ball(robot: Robot, part: str, *, opposition: float = 1.2) -> HeldBall:
    """Returns the ball on the palm that the largest number of fingers touch.

    Every ball that the thumb and another finger touch is preferred to every other ball. Among balls with
    equal numbers of fingers, returns the ball that the skin of the fingers faces most directly. The thumb is
    opposed to the palm by `opposition` [rad], which is the angle in a light grasp. Raises TciError if the
    hand has no skin on the palm, or if no finger touches a ball.
    """
    worn: dict[str, list[Surface]] = {}
    for patch, surface in zip(robot.patches, surfaces_of(robot), strict=True):
        if patch.part == part:
            worn.setdefault(patch.segment, []).append(surface)
    if PALM not in worn:
        raise TciError(f"{part} of {robot.name}: no skin on its palm; valid: a patch of the segment {PALM}")
    palm = worn[PALM][0]
    open_hand = np.array(robot.part(part).initial_posture)
    open_hand[0] = max(open_hand[0], opposition)
    tips = {finger: worn[finger] for finger in FINGERS if finger in worn}
    paths = _paths(robot, part, palm.link, tips, open_hand)
    best: tuple[tuple[int, float], HeldBall] | None = None
    for radius in RADII:
        for taxel, normal in enumerate(palm.normals):
            place = palm.positions[taxel]
            found = {finger: _meeting(path, place, normal, radius) for finger, path in paths.items()}
            meetings = {finger: one for finger, one in found.items() if one is not None}
            met = {finger: one for finger, one in meetings.items() if one.faces > 0.0}
            if not met or len(meetings) < len(paths):
                continue
            count = len(met) + len(paths) * ("thumb" in met and len(met) > 1)
            score = count, sum(one.faces for one in met.values())
            if best is None or score > best[0]:
                posture = _waiting(joint_map(robot, part), open_hand, meetings, met)
                best = score, HeldBall(palm.patch, taxel, float(radius), tuple(met), posture)
    if best is None:
        raise TciError(f"{part} of {robot.name}: its fingers meet no ball on its palm")
    return best[1]


def _waiting(
    joints: JointMap, open_hand: Array, meetings: Mapping[str, _Meeting], met: Collection[str]
) -> Array:
    """Returns the posture (10,) [rad] of a hand just before the grasp. `meetings` describes the contact of
    each finger with the ball, and `met` names the fingers that will touch it.

    Fingers that will touch the ball are bent up to a position just beside the ball, and fingers that share a
    motor with them are bent to the same flexion.
    """
    posture = np.array(open_hand)
    for group in joints.tied:
        bent = [joint for joint in group if joint in FLEXIONS]
        fingers = {FINGERS[FLEXIONS.index(joint)] for joint in bent}
        if fingers & set(met):
            posture[bent] = min(meetings[finger].start for finger in fingers & meetings.keys())
    return read_only(posture)


def _paths(
    robot: Robot, part: str, palm: str, tips: Mapping[str, Sequence[Surface]], open_hand: Array
) -> dict[str, _Path]:
    """Returns, by finger, the path of the finger's taxels while all fingers bend from the posture
    `open_hand` (10,) [rad]. `palm` is the link of the palm."""
    chain, joints, bends = KinematicChain(robot), joint_map(robot, part), list(FLEXIONS)
    links = tuple(dict.fromkeys((palm, *(pad.link for pads in tips.values() for pad in pads))))
    angles: list[Array] = []
    poses: list[dict[str, Array]] = []
    for bend in BENDS:
        bent = np.array(open_hand)
        bent[bends] = np.maximum(bent[bends], bend)
        position = start_angles(robot, {part: bent})
        angles.append(joints.to_generic(position)[bends])
        T_TL = dict(zip(links, chain.pose_array(position, links), strict=True))
        poses.append({link: invert(T_TL[palm]) @ pose for link, pose in T_TL.items()})
    return {
        finger: _Path(
            np.array(angles)[:, FINGERS.index(finger)],
            np.array([np.vstack([apply(row[pad.link], pad.positions) for pad in pads]) for row in poses]),
            np.array([np.vstack([pad.normals @ row[pad.link][:3, :3].T for pad in pads]) for row in poses]),
        )
        for finger, pads in tips.items()
    }


def _meeting(path: _Path, place: Array, normal: Array, radius: float) -> _Meeting | None:
    """Returns the contact between a finger and a ball on the palm.

    `path` is the path of the fingertip, `place` (3,) [m] the point of the palm under the ball, `normal` (3,)
    the palm's outward normal, and `radius` [m] the ball's radius. Returns None if the open finger blocks the
    ball's path to the palm.
    """
    centre = place + radius * normal
    gap, before = (
        np.linalg.norm(path.positions - at, axis=2).min(axis=1) - radius
        for at in (centre, centre + WAY * normal)
    )
    clear = np.minimum(gap, before) > CLEAR
    if not clear[0]:
        return None
    wait = len(clear) - 1 if clear.all() else int(np.argmin(clear)) - 1
    start = float(path.angles[wait])
    if gap.min() > -SINKS:
        return _Meeting(start, 0.0)
    first = int(np.argmax(gap < 0.0))
    to_centre = centre - path.positions[first]
    nearest = int(np.argmin(np.linalg.norm(to_centre, axis=1)))
    inward = to_centre[nearest] / np.linalg.norm(to_centre[nearest])
    faces, lifts = float(path.normals[first, nearest] @ inward), float(inward @ normal)
    return _Meeting(start, faces - max(lifts, 0.0) if faces > FACES and lifts < LIFTS else 0.0)
