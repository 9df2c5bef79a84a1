"""Gestures from motion capture: BVH files (Biovision hierarchy) with any convention of axes.

The reader finds the arms in a skeleton by the usual names of arm joints. Angles of shoulder, elbow and
pronation are computed from positions and directions in space, so these angles are independent of the file's
convention for rotations.

Which way the chest and the thumbs point is read in a rest pose: the zero pose of the skeleton if this is a
person whose arms hang or point sideways, else the frame that comes nearest to such a person. Assumed: the
thumbs point forward there, because this is natural for such arms.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from tci.errors import TciError
from tci.gestures.gesture import Gesture
from tci.gestures.rows import read_lines
from tci.gestures.skeleton import Bone, pose, read_skeleton, use_positions
from tci.messages.frames import Array, angle_between, read_only
from tci.robot.generic_arm import JOINTS, Side, shoulder_angles, side_sign
from tci.robot.xml.document import refuse, shown

BLOCK = 4096
"""Number of frames that are processed at once. Assumed: this number bounds the memory for the rotations of
all bones."""
STRAIGHT = 0.1
"""The elbow counts as straight if the sine of its angle is below this number. The direction of the forearm
then does not determine the rotation of the upper arm about its own axis. Assumed: at the sine 0.1 (6 degrees)
the rotation is still useful, although an error of position changes it ten times as much as at a right angle.
"""
NONE = 1e-6
"""Norm below which a cross product counts as zero, since such a small norm is only rounding error."""
FASTEST = 25.0
"""Angular speed [rad/s] of a limb between two frames, above which the change is not a real motion. Assumed:
of all human limbs, only a pitcher's forearm reaches this speed."""
LOOKED_AT = 2000
"""Largest number of frames, evenly spread over the file, in which a rest pose is looked for. Assumed: this
number bounds the time to about a second."""
SIDES: tuple[Side, ...] = ("left", "right")
ROLES = {
    "upper_arm": r"upper_?arm|up_?arm|arm_?upper|arm|shldr|shoulder",
    "forearm": r"fore_?arm|low_?arm|lower_?arm|arm_?lower|elbow",
    "hand": r"hand|wrist",
}
"""Patterns for the names of an arm's joints, without the side. In the file, the side (left or right, l or r)
is before or after each name."""


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """A gesture from a file of another program, and what became of the content of this file."""

    gesture: Gesture
    names: dict[str, list[str]]
    """Names of the joints of each part of the gesture."""
    used: tuple[str, ...]
    """What was used, in words for a user."""
    left_out: tuple[str, ...]
    """What the file contains and the gesture does not, in words for a user."""


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A pose in which the person stands with arms that hang or point sideways."""

    rotations: Array
    """Rotations (bones, 3, 3) of the bones in the file's world frame."""
    R_WT: Array
    """Rotation (3, 3) of the torso in the file's world frame."""
    told: str


def read_bvh(path: Path) -> Imported:
    """Reads a gesture of both arms from a BVH file. The angles are relative to the link that carries both
    arms.

    Raises DescriptionError with the line of the error and the valid content.
    """
    source = str(path)
    bones, period, frames = read_skeleton(source, read_lines(path))
    try:
        return _gesture(bones, period, frames)
    except TciError as error:
        raise refuse(source, 0, str(error)) from error


def _gesture(bones: list[Bone], period: float, frames: Array) -> Imported:
    arms = {side: [_find(bones, side, role) for role in ROLES] for side in SIDES}
    lines = [_line(bones, arm[0]) for arm in arms.values()]
    chest = next((bone for bone in lines[0] if bone in lines[1]), None)
    if chest is None:
        raise TciError("the arms hang on nothing in common; valid: one skeleton with one ROOT")
    places_told = use_positions(bones, frames)
    rest = _rest(bones, arms, chest, frames)
    # The torso in the frame of the chest.
    R_CT = rest.rotations[chest].T @ rest.R_WT
    postures: dict[str, list[Array]] = {f"{side}_arm": [] for side in SIDES}
    bends = {side: np.zeros(3) for side in SIDES}  # the axis of an earlier frame does not exist
    begin = int(_begins_with_rest(bones, arms, chest, period, frames))
    for block in range(begin, len(frames), BLOCK):
        rotations, places = pose(bones, frames[block : block + BLOCK])
        R_WT = rotations[:, chest] @ R_CT
        for side, arm in arms.items():
            points = places[:, arm] @ R_WT
            hand = rotations[:, arm[2]] @ rest.rotations[arm[2]].T @ rest.R_WT[:, 0]
            thumb = np.einsum("kji,kj->ki", R_WT, hand)
            angles, bends[side] = _postures(points, thumb, side, bends[side])
            postures[f"{side}_arm"].append(angles)
    # Angles are continuous from frame to frame, without jumps by a full turn.
    angles_of = {part: np.unwrap(np.concatenate(rows), axis=0) for part, rows in postures.items()}
    times = period * np.arange(len(frames) - begin)
    carried = {bone for arm in arms.values() for end in (arm[2], *arm) for bone in (end, *_line(bones, end))}
    kept = sorted(carried - {chest, *_line(bones, chest)})
    others = [bone for bone in range(len(bones)) if bone not in kept]
    used = [f"{len(kept)} joints: {_listed(bones, kept)}, as {bones[chest].name!r} sees them", rest.told]
    left_out = ["bending of the wrists"]
    left_out.append(f"motion of {len(others)} other joints: {_listed(bones, others)}")
    if begin:
        left_out.append("frame 1, a rest pose from which no person gets to frame 2 in time")
    return Imported(
        Gesture(read_only(times), {part: read_only(rows) for part, rows in angles_of.items()}),
        {part: list(JOINTS) for part in angles_of},
        (*used, *places_told),
        tuple(left_out),
    )


def _listed(bones: list[Bone], which: list[int]) -> str:
    return ", ".join(shown(bones[bone].name) for bone in which)


def _rest(bones: list[Bone], arms: dict[Side, list[int]], chest: int, frames: Array) -> Rest:
    """In a frame, the person may lean, so there the torso is along the line from the hips to the shoulders.

    Raises TciError if neither the zero pose nor a frame is a rest pose.
    """
    zero = np.zeros((1, frames.shape[1]))
    for bone in bones[1:]:
        zero[0, bone.moved] = np.median(frames[:, bone.moved], axis=0)
    body = _body(bones, frames)
    below = [bone for bone in range(len(bones)) if body in (bone, *_line(bones, bone))]
    rotations, places = pose(bones, zero)
    R_WT, off, reason = _standing(places[0], arms, body, below)
    reason = f"the zero pose of the skeleton is no person with arms that hang or point sideways ({reason})"
    if off <= 1.0:
        return Rest(rotations[0], R_WT, "the zero pose of the skeleton as the rest pose")
    which = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), LOOKED_AT)).astype(int))
    rotations, places = pose(bones, frames[which])
    found = [_standing(place, arms, body, below) for place in places]
    best = min(range(len(found)), key=lambda index: found[index][1])
    at = which[best] + 1
    if found[best][1] > 1.0:
        raise TciError(
            f"no rest pose: {reason}, and no frame is better (at best, frame {at}: {found[best][2]}); valid: "
            "a zero pose or a frame of a person who stands with arms that hang or point sideways, for "
            "example a T-pose as the first frame"
        )
    left, right = (places[best, arms[side][0]] for side in SIDES)
    trunk = (left + right) / 2.0 - places[best, body]
    R_WT = _axes(left - right, trunk) if body != chest else found[best][0]
    return Rest(rotations[best], R_WT, f"frame {at} as the rest pose, since {reason}")


def _body(bones: list[Bone], frames: Array) -> int:
    """Returns the bone from which the skeleton stands up: the root, or what a root that stays behind carries
    through space."""
    body = 0
    while True:
        children = [index for index, bone in enumerate(bones) if bone.parent == body]
        if len(children) != 1 or not np.ptp(frames[:, bones[children[0]].moved], axis=0).any():
            return body
        body = children[0]


def _standing(
    places: Array, arms: dict[Side, list[int]], body: int, below: list[int]
) -> tuple[Array, float, str]:
    """Returns the torso's rotation (3, 3) in the file's world frame, how far the pose with the bones at
    `places` (bones, 3) is from a person whose arms hang or point sideways, and what is most off, in words. Up
    to a distance of 1, the pose counts as such a person.

    Assumed: the tolerances, which a person who stands at ease meets, and a walking person at times.
    """
    left, right = arms["left"][0], arms["right"][0]
    middle = (places[left] + places[right]) / 2.0
    spine, line = middle - places[body], places[left] - places[right]
    if np.linalg.norm(line) < NONE * max(float(np.ptp(places[below], axis=0).max()), NONE):
        return np.eye(3), np.inf, "both shoulders are at one place"
    R_WT, up = _torso(places[below], line, spine)
    off: list[tuple[float, float, str]] = [
        (float(np.arcsin(abs(_unit(line) @ up))), 15.0, "one shoulder is {:.0f} degrees above the other"),
        (angle_between(R_WT[:, 2], spine), 30.0, "the trunk leans by {:.0f} degrees"),
    ]
    limbs: dict[tuple[str, str], Array] = {}
    for side, arm in arms.items():
        for limb, (a, b), most in (("upper arm", arm[:2], 30.0), ("forearm", arm[1:], 60.0)):
            direction = places[b] - places[a]
            if np.linalg.norm(direction) == 0.0:
                return np.eye(3), np.inf, f"two joints of the {side} arm are at one place"
            x, y, z = _unit(direction) @ R_WT
            y *= side_sign(side)
            limbs[side, limb] = np.array([x, y, z])
            name = f"the {side} {limb} points {{:.0f}} degrees"
            off += [
                (np.arcsin(min(abs(x), 1.0)), most, f"{name} {'forward' if x > 0 else 'backward'}"),
                (np.arcsin(np.clip(z, 0.0, 1.0)), 20.0, f"{name} above horizontal"),
                (np.arcsin(np.clip(-y, 0.0, 1.0)), most, f"{name} across the body"),
            ]
    for limb in ("upper arm", "forearm"):
        between = angle_between(limbs["left", limb], limbs["right", limb])
        off.append((between, 40.0, f"the two {limb}s differ by {{:.0f}} degrees"))
    worst, angle, words = max(
        (np.rad2deg(angle) / most, np.rad2deg(angle), words) for angle, most, words in off
    )
    return R_WT, float(worst), words.format(angle)


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _begins_with_rest(
    bones: list[Bone], arms: dict[Side, list[int]], chest: int, period: float, frames: Array
) -> bool:
    """Returns True if the first frame is a rest pose, which some programs insert before the motion.

    The first frame counts as a rest pose if a limb would turn impossibly fast (above FASTEST) between the
    first and the second frame.
    """
    if len(frames) < 3:
        return False
    rotations, places = pose(bones, frames[:2])
    limbs = [
        np.array([(place[b] - place[a]) @ rotation[chest] for arm in arms.values() for a, b in pairwise(arm)])
        for rotation, place in zip(rotations, places, strict=True)
    ]
    turned = [angle_between(one, other) for one, other in zip(*limbs, strict=True)]
    return max(turned) / period > FASTEST


def _find(bones: list[Bone], side: Side, role: str) -> int:
    """Returns the index of the bone that has a `role`, for example `forearm`, in the arm on one `side`.

    A bone named `shoulder` counts as the upper arm if the forearm is attached to this bone, else as the
    collar bone.
    """
    role_of, at, gap = f"(?P<role>{ROLES[role]})", f"({side}|{side[0]})", "[_ .-]?"
    pattern = re.compile(
        rf"(.*[:_ .-])?({at}{gap}{role_of}|{role_of.replace('role', 'last')}{gap}{at})", re.I
    )
    found = [
        (index, match["role"] or match["last"])
        for index, bone in enumerate(bones)
        if (match := pattern.fullmatch(bone.name))
    ]
    if role == "upper_arm":
        forearm = _find(bones, side, "forearm")
        found = [
            (index, name)
            for index, name in found
            if name.lower() != "shoulder" or bones[forearm].parent == index
        ]
    if not found:
        raise TciError(
            f"no {side} {role.replace('_', ' ')} among the joints; valid: LeftArm, arm_l and the like; got "
            f"{_listed(bones, list(range(min(len(bones), 40))))}"
        )
    return found[0][0]


def _line(bones: list[Bone], bone: int) -> list[int]:
    line = []
    while bone >= 0:
        line.append(bone)
        bone = bones[bone].parent
    return line[1:]


def _torso(places: Array, line: Array, spine: Array) -> tuple[Array, Array]:
    """Returns the rotation (3, 3) of the torso frame in the file's world frame, and the up direction (3,) of
    the file.

    The torso's left direction is along `line` (3,), from the right to the left shoulder. Its up direction is
    near the coordinate axis of the file along which the skeleton with its bones at `places` (k, 3) is
    longest, on the side to which `spine` (3,) points, which goes from the hips to the shoulders.
    """
    y = _unit(line)
    extent = np.ptp(places, axis=0) * (np.abs(y) < 0.7)
    up = np.eye(3)[int(np.argmax(extent))]
    up = up * np.sign(up @ spine or 1.0)
    return _axes(y, up), up


def _axes(left: Array, up: Array) -> Array:
    y = _unit(left)
    z = _unit(up - y * float(y @ up))
    return np.column_stack([np.cross(y, z), y, z])


def _postures(points: Array, thumb: Array, side: Side, before: Array) -> tuple[Array, Array]:
    """Returns generic angles (k, 5) [rad] of an arm in k frames, and the axis (3,) of elbow extension in the
    last frame.

    `points` (k, 3, 3) are the positions of shoulder, elbow and wrist, and `thumb` (k, 3) the direction of the
    thumb. The axis can't be measured while the elbow is straight; then the axis of the previous frame is
    used, and in the first frame the axis `before` (3,). If `before` is zero, the axis is chosen so that the
    forearm would bend forward.
    """
    steps = np.diff(points, axis=1)
    lengths = np.linalg.norm(steps, axis=2, keepdims=True)
    if not lengths.all():
        raise TciError(f"two joints of the {side} arm are at one place; valid: a skeleton with its offsets")
    upper, fore = np.moveaxis(steps / lengths, 1, 0)
    across = np.cross(fore, upper)
    sine = np.linalg.norm(across, axis=1)
    flexion = np.arctan2(sine, np.einsum("ki,ki->k", upper, fore))
    y = across / np.maximum(sine, NONE)[:, None]
    for index in np.flatnonzero(sine <= STRAIGHT):
        y[index] = _bend(upper[index], y[index - 1] if index else before)
    z = -upper
    x = np.cross(y, z)
    shoulder = np.array([shoulder_angles(R_MU, side) for R_MU in np.stack([x, y, z], axis=-1)]).reshape(-1, 3)
    # axis x of the forearm at zero pronation
    flexor = np.cos(flexion)[:, None] * x + np.sin(flexion)[:, None] * z
    pronation = np.arctan2(np.einsum("ki,ki->k", y, thumb), np.einsum("ki,ki->k", flexor, thumb))
    return np.column_stack([shoulder, flexion, -side_sign(side) * pronation]), y[-1]


def _bend(upper: Array, before: Array) -> Array:
    """Returns the axis of extension (3,) of an elbow that is too straight to measure it: the previous axis
    `before` (3,), made perpendicular to the upper arm's direction `upper` (3,). If this is impossible,
    returns an axis about which the forearm would bend forward."""
    forward, left = np.eye(3)[:2]
    choices = (before - upper * float(before @ upper), np.cross(forward, upper), left)
    lengths = [float(np.linalg.norm(choice)) for choice in choices]
    best = next(index for index, length in enumerate(lengths) if length > NONE)
    bend: Array = choices[best] / lengths[best]
    return bend
