"""Gestures from motion capture: BVH files (Biovision hierarchy) with any convention of axes.

The reader finds the arms in a skeleton by the usual names of arm joints. Angles of shoulder, elbow and
pronation are computed from positions and directions in space, so these angles are independent of the file's
convention for rotations. Assumed: the thumbs point forward in the file's rest pose, because this is natural
for arms that hang or are stretched out sideways.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tci.errors import TciError
from tci.gestures.gesture import Gesture
from tci.gestures.rows import LARGEST, read_rows
from tci.messages.frames import Array, angle_between, read_only
from tci.robot.generic_arm import Side, shoulder_angles, side_sign
from tci.robot.xml.document import read_bytes, refuse, shown
from tci.robot.xml.values import InvalidValueError, decimal

BONES = 250
"""Largest number of joints of a skeleton. Assumed: a skeleton with all fingers has about 60 joints."""
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
ROLES = {
    "upper_arm": r"(upper_?arm|up_?arm|arm|shldr|shoulder)",
    "forearm": r"(fore_?arm|low_?arm|lower_?arm|elbow)",
    "hand": r"(hand|wrist)",
}
"""Patterns for the names of an arm's joints. In the file, each name begins with the side (left or right). The
patterns do not contain the side."""
CHANNELS = tuple(f"{axis}{what}" for what in ("position", "rotation") for axis in "XYZ")


@dataclass(slots=True)
class Bone:
    """A joint of the skeleton in the file."""

    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()
    first: int = 0


def read_bvh(path: Path) -> Gesture:
    """Reads a gesture of both arms from a BVH file. The angles are relative to the link that carries both
    arms.

    Raises DescriptionError with the line of the error and the valid content.
    """
    source = str(path)
    text = read_bytes(path, limit=LARGEST).decode("utf-8", errors="replace")
    bones, period, frames = _parse(source, list(io.StringIO(text, newline=None)))
    try:
        return _gesture(bones, period, frames)
    except TciError as error:
        raise refuse(source, 0, str(error)) from error


def _parse(source: str, lines: list[str]) -> tuple[list[Bone], float, Array]:
    """Returns the content of a BVH file, given as `lines`: its bones, the time [s] between frames, and the
    values of all channels (frames, channels)."""
    bones: list[Bone] = []
    stack: list[int] = []
    current, channels, start = -1, 0, -1
    end_site = False
    taken: set[str] = set()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0] in ("HIERARCHY",):
            continue
        if words[0] == "MOTION":
            start = number
            break
        if words[0] in ("ROOT", "JOINT") and len(words) >= 2:
            name = " ".join(words[1:])
            if len(bones) == BONES or name in taken:
                reason = f"second joint {shown(name)}" if name in taken else "too large"
                raise refuse(source, number, f"{reason}; valid: at most {BONES} joints, each of its own name")
            taken.add(name)
            bones.append(Bone(name, stack[-1] if stack else -1, np.zeros(3)))
            current = len(bones) - 1
        elif words[:2] == ["End", "Site"]:
            end_site = True
        elif words[0] == "{":
            stack.append(current)
        elif words[0] == "}" and stack:
            stack.pop()
            end_site = False
        elif words[0] == "OFFSET" and len(words) == 4:
            if not end_site and bones:
                bones[current].offset = np.array([_number(source, word, number) for word in words[1:]])
        elif words[0] == "CHANNELS" and bones:
            names = tuple(words[2:])
            if words[1:2] != [str(len(names))] or len({*names} & {*CHANNELS}) != len(names):
                found = shown(" ".join(words[1:]))
                valid = f"{', '.join(CHANNELS)}, each once, after their number"
                raise refuse(source, number, f"channels {found}; valid: {valid}")
            bones[current].channels, bones[current].first = names, channels
            channels += len(names)
        else:
            raise refuse(
                source, number, f"{words[0][:20]!r}; valid: ROOT, JOINT, End Site, OFFSET, CHANNELS, {{ }}"
            )
    if start < 0 or not channels:
        raise refuse(source, 0, "no HIERARCHY with CHANNELS and a MOTION after it; valid: a BVH file")
    head = [line.split() for line in lines[start : start + 2]]
    if [words[:-1] for words in head] != [["Frames:"], ["Frame", "Time:"]]:
        raise refuse(source, start + 1, "valid after MOTION: 'Frames: N' and 'Frame Time: SECONDS'")
    declared, period = _number(source, head[0][-1], start + 1), _number(source, head[1][-1], start + 2)
    rows = read_rows(source, lines, start + 2, channels, mark=None)
    if not 0.0 < declared <= len(rows):
        raise refuse(
            source, start + 1, f"{declared:g} frames, of which {len(rows)} are there; valid: a whole file"
        )
    if len(rows) < 2 or not 0.0 < period < 10.0:
        raise refuse(source, start + 1, f"{len(rows)} frames of {period} s; valid: 2 or more, each above 0 s")
    return bones, period, rows


def _number(source: str, word: str, line: int) -> float:
    try:
        return decimal(word)
    except InvalidValueError as error:
        raise refuse(source, line, f"{word[:20]!r}; valid: {error}") from None


def _gesture(bones: list[Bone], period: float, frames: Array) -> Gesture:
    sides: tuple[Side, ...] = ("left", "right")
    arms = {side: [_find(bones, side, role) for role in ROLES] for side in sides}
    lines = [_line(bones, arm[0]) for arm in arms.values()]
    chest = next((bone for bone in lines[0] if bone in lines[1]), None)
    if chest is None:
        raise TciError("the arms hang on nothing in common; valid: one skeleton with one ROOT")
    rest_rotations, rest = _pose(bones, np.zeros((1, frames.shape[1])))
    R_RT = _torso(rest[0], arms["left"][0], arms["right"][0])
    postures: dict[str, list[Array]] = {f"{side}_arm": [] for side in sides}
    bends = {side: np.zeros(3) for side in sides}  # the axis of an earlier frame does not exist
    begin = int(_begins_with_rest(bones, arms, chest, period, frames))
    for block in range(begin, len(frames), BLOCK):
        rotations, places = _pose(bones, frames[block : block + BLOCK])
        R_WT = rotations[:, chest] @ R_RT
        for side, arm in arms.items():
            points = places[:, arm] @ R_WT
            hand = rotations[:, arm[2]] @ rest_rotations[0, arm[2]].T @ R_RT[:, 0]
            thumb = np.einsum("kji,kj->ki", R_WT, hand)
            angles, bends[side] = _postures(points, thumb, side, bends[side])
            postures[f"{side}_arm"].append(angles)
    # Angles are continuous from frame to frame, without jumps by a full turn.
    angles_of = {part: np.unwrap(np.concatenate(rows), axis=0) for part, rows in postures.items()}
    times = period * np.arange(len(frames) - begin)
    return Gesture(read_only(times), {part: read_only(rows) for part, rows in angles_of.items()})


def _begins_with_rest(
    bones: list[Bone], arms: dict[Side, list[int]], chest: int, period: float, frames: Array
) -> bool:
    """Returns True if the first frame is a rest pose, which some programs insert before the motion.

    The first frame counts as a rest pose if a limb would turn impossibly fast (above FASTEST) between the
    first and the second frame.
    """
    if len(frames) < 3:
        return False
    rotations, places = _pose(bones, frames[:2])
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
    pattern = re.compile(rf"^(.*[:_])?({side}|{side[0]})[_ .-]?{ROLES[role]}$", re.IGNORECASE)
    found = [index for index, bone in enumerate(bones) if pattern.match(bone.name)]
    if role == "upper_arm":
        forearm = _find(bones, side, "forearm")
        found = [
            index
            for index in found
            if not bones[index].name.lower().endswith("shoulder") or bones[forearm].parent == index
        ]
    if not found:
        names = ", ".join(bone.name for bone in bones[:40])
        raise TciError(
            f"no {side} {role.replace('_', ' ')} among the joints; valid: LeftArm and the like; got {names}"
        )
    return found[0]


def _line(bones: list[Bone], bone: int) -> list[int]:
    line = []
    while bone >= 0:
        line.append(bone)
        bone = bones[bone].parent
    return line[1:]


def _pose(bones: list[Bone], frames: Array) -> tuple[Array, Array]:
    """Returns rotations (k, bones, 3, 3) and positions (k, bones, 3) of all bones in the file's world frame,
    for k `frames` (k, channels)."""
    rotations, places = np.empty((len(frames), len(bones), 3, 3)), np.empty((len(frames), len(bones), 3))
    for number, bone in enumerate(bones):
        values = frames[:, bone.first : bone.first + len(bone.channels)]
        turns = [index for index, channel in enumerate(bone.channels) if channel.endswith("rotation")]
        rotation: Array = np.eye(3)
        if turns:
            order = "".join(bone.channels[index][0] for index in turns)
            rotation = Rotation.from_euler(order, values[:, turns], degrees=True).as_matrix()
        if bone.parent >= 0:
            base = rotations[:, bone.parent]
            places[:, number] = places[:, bone.parent] + base @ bone.offset
            rotations[:, number] = base @ rotation
        else:
            places[:, number], rotations[:, number] = bone.offset, rotation
            for index, channel in enumerate(bone.channels):
                if index not in turns:
                    places[:, number, "XYZ".index(channel[0])] += values[:, index]
    return rotations, places


def _torso(rest: Array, left: int, right: int) -> Array:
    """Returns the rotation (3, 3) of the torso frame in the file's world frame, computed from the positions
    `rest` of the bones in the rest pose. `left` and `right` are the indices of the two shoulders.

    Its left direction points from the right to the left shoulder. Its up direction is near the coordinate
    axis of the file along which the skeleton is longest.
    """
    y = rest[left] - rest[right]
    if np.linalg.norm(y) < 1e-6:
        raise TciError("both shoulders are at one place in the rest pose; valid: a skeleton with its offsets")
    y = y / np.linalg.norm(y)
    extent = np.ptp(rest, axis=0) * (np.abs(y) < 0.7)
    up = np.eye(3)[int(np.argmax(extent))]
    middle = (rest[left] + rest[right]) / 2.0
    up = up * np.sign(up @ (middle - rest[0]) or 1.0)
    z = up - y * float(y @ up)
    z = z / np.linalg.norm(z)
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
