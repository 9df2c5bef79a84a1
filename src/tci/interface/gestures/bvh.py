"""Gestures from motion capture: BVH files (Biovision hierarchy), whatever their skeleton's axes.

The arms are found by the usual names of their joints. Shoulder, elbow and pronation follow from where the
joints are, so that no convention of the file's rotations matters; the thumb is taken to point forward in
the file's rest pose, as it does with the arms hanging or stretched out sideways.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from tci.errors import DescriptionError, Fault, TciError
from tci.frames import Array, angle_between, read_only, rotation_x, rotation_y, rotation_z
from tci.interface.gestures.gesture import Gesture
from tci.model.generic_arm import Side, forearm_rotation, shoulder_angles, side_sign
from tci.model.xml.document import read_bytes

LARGEST = 64 << 20
"""Largest file [bytes]."""
STRAIGHT = 0.1
"""Sine of the elbow's angle below which it does not tell how the upper arm is turned. Ours."""
NONE = 1e-6
"""Length of a cross product that is only rounding."""
FASTEST = 25.0
"""Speed [rad/s] that no limb of a person has: a pitcher's forearm gets there. Ours."""
ROLES = {
    "upper_arm": r"(upper_?arm|up_?arm|arm|shldr|shoulder)",
    "forearm": r"(fore_?arm|low_?arm|lower_?arm|elbow)",
    "hand": r"(hand|wrist)",
}
"""What joints of an arm are called, after their side."""
TURNS = {"X": rotation_x, "Y": rotation_y, "Z": rotation_z}
CHANNELS = tuple(f"{axis}{what}" for what in ("position", "rotation") for axis in TURNS)


@dataclass(slots=True)
class Bone:
    """A joint of the skeleton."""

    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()
    first: int = 0


def read_bvh(path: Path) -> Gesture:
    """The gesture of both arms in a BVH file, in the frame of the link that carries them.

    Raises DescriptionError with the line and what would be valid.
    """
    source = str(path)
    text = read_bytes(path, limit=LARGEST).decode("utf-8", errors="replace")
    try:
        bones, period, frames = _parse(text.splitlines())
        return _gesture(bones, period, frames)
    except _BadLineError as error:
        raise DescriptionError(source, [Fault(error.line, str(error))]) from None
    except TciError as error:
        raise DescriptionError(source, [Fault(0, str(error))]) from error


class _BadLineError(Exception):
    def __init__(self, line: int, message: str) -> None:
        super().__init__(message)
        self.line = line


def _parse(lines: list[str]) -> tuple[list[Bone], float, Array]:
    """The bones, the time [s] between frames, and the channels' values (frames, channels)."""
    bones: list[Bone] = []
    stack: list[int] = []
    current, channels, start = -1, 0, -1
    end_site = False
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0] in ("HIERARCHY",):
            continue
        if words[0] == "MOTION":
            start = number
            break
        if words[0] in ("ROOT", "JOINT") and len(words) >= 2:
            bones.append(Bone(" ".join(words[1:]), stack[-1] if stack else -1, np.zeros(3)))
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
                bones[current].offset = np.array([_number(word, number) for word in words[1:]])
        elif words[0] == "CHANNELS" and bones:
            names = tuple(words[2:])
            if any(name not in CHANNELS for name in names):
                raise _BadLineError(number, f"channels {' '.join(names)}; valid: {', '.join(CHANNELS)}")
            bones[current].channels, bones[current].first = names, channels
            channels += len(names)
        else:
            raise _BadLineError(
                number, f"{words[0][:20]!r}; valid: ROOT, JOINT, End Site, OFFSET, CHANNELS, {{ }}"
            )
    if start < 0 or not bones:
        raise _BadLineError(0, "no HIERARCHY with a MOTION after it; valid: a BVH file")
    head = [line.split() for line in lines[start : start + 2]]
    if len(head) < 2 or head[0][:1] != ["Frames:"] or head[1][:2] != ["Frame", "Time:"]:
        raise _BadLineError(start + 1, "valid after MOTION: 'Frames: N' and 'Frame Time: SECONDS'")
    declared, period = _number(head[0][-1], start + 1), _number(head[1][-1], start + 2)
    rows = []
    for number, line in enumerate(lines[start + 2 :], start=start + 3):
        if words := line.split():
            if len(words) != channels:
                raise _BadLineError(number, f"{len(words)} values; valid: {channels}, one for each channel")
            rows.append([_number(word, number) for word in words])
    if len(rows) < declared:
        raise _BadLineError(
            start + 1, f"{declared:g} frames, of which {len(rows)} are there; valid: a whole file"
        )
    if len(rows) < 2 or not 0.0 < period < 10.0:
        raise _BadLineError(start + 1, f"{len(rows)} frames of {period} s; valid: 2 or more, each above 0 s")
    return bones, period, np.array(rows)


def _number(word: str, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _BadLineError(line, f"{word[:20]!r}; valid: a finite number")
    return value


def _gesture(bones: list[Bone], period: float, frames: Array) -> Gesture:
    sides: tuple[Side, ...] = ("left", "right")
    arms = {side: [_find(bones, side, role) for role in ROLES] for side in sides}
    lines = [_line(bones, arm[0]) for arm in arms.values()]
    chest = next((bone for bone in lines[0] if bone in lines[1]), None)
    if chest is None:
        raise TciError("the arms hang on nothing in common; valid: one skeleton with one ROOT")
    rest_rotations, rest = _pose(bones, np.zeros(frames.shape[1]))
    R_RT = _torso(rest, arms["left"][0], arms["right"][0])
    postures: dict[str, list[Array]] = {f"{side}_arm": [] for side in sides}
    bends = {side: np.zeros(3) for side in sides}  # nothing is known yet
    for frame in frames[1:] if _begins_with_rest(bones, arms, chest, period, frames) else frames:
        rotations, places = _pose(bones, frame)
        R_WT = rotations[chest] @ R_RT
        for side, (upper, fore, hand) in arms.items():
            points = np.array([places[upper], places[fore], places[hand]]) @ R_WT
            thumb = R_WT.T @ rotations[hand] @ rest_rotations[hand].T @ R_RT[:, 0]
            posture, bends[side] = _posture(points, thumb, side, bends[side])
            postures[f"{side}_arm"].append(posture)
    # No angle jumps by a turn from one frame to the next.
    angles = {part: np.unwrap(np.array(rows), axis=0) for part, rows in postures.items()}
    times = period * np.arange(len(angles["left_arm"]))
    return Gesture(read_only(times), {part: read_only(rows) for part, rows in angles.items()})


def _begins_with_rest(
    bones: list[Bone], arms: dict[Side, list[int]], chest: int, period: float, frames: Array
) -> bool:
    """Whether the first frame is a pose that some makers put before the motion: a limb would have to turn
    faster than anybody's to the second one."""
    if len(frames) < 3:
        return False
    limbs = []
    for frame in frames[:2]:
        rotations, places = _pose(bones, frame)
        ends = [(places[b] - places[a]) @ rotations[chest] for arm in arms.values() for a, b in pairwise(arm)]
        limbs.append(np.array(ends))
    turned = [angle_between(one, other) for one, other in zip(*limbs, strict=True)]
    return max(turned) / period > FASTEST


def _find(bones: list[Bone], side: Side, role: str) -> int:
    """The bone of a side and role. A `shoulder` is an upper arm where the forearm hangs on it; else it is the
    collar bone."""
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


def _pose(bones: list[Bone], values: Array) -> tuple[list[Array], list[Array]]:
    """Rotation (3, 3) and place (3,) of every bone in the file's world."""
    rotations: list[Array] = []
    places: list[Array] = []
    for bone in bones:
        rotation, shift = np.eye(3), np.array(bone.offset)
        for index, channel in enumerate(bone.channels):
            value = float(values[bone.first + index])
            if channel.endswith("rotation"):
                rotation = rotation @ TURNS[channel[0]](np.deg2rad(value))
            elif bone.parent < 0:
                shift["XYZ".index(channel[0])] += value
        if bone.parent >= 0:
            base = rotations[bone.parent]
            shift, rotation = places[bone.parent] + base @ shift, base @ rotation
        rotations.append(rotation)
        places.append(shift)
    return rotations, places


def _torso(rest: list[Array], left: int, right: int) -> Array:
    """The torso frame seen from the file's world in the rest pose (3, 3): the shoulders say what is left, and
    up is the axis of the file along which the skeleton is longest across it."""
    y = rest[left] - rest[right]
    if np.linalg.norm(y) < 1e-6:
        raise TciError("both shoulders are at one place in the rest pose; valid: a skeleton with its offsets")
    y = y / np.linalg.norm(y)
    extent = np.ptp(np.array(rest), axis=0) * (np.abs(y) < 0.7)
    up = np.eye(3)[int(np.argmax(extent))]
    middle = (rest[left] + rest[right]) / 2.0
    up = up * np.sign(up @ (middle - rest[0]) or 1.0)
    z = up - y * float(y @ up)
    z = z / np.linalg.norm(z)
    return np.column_stack([np.cross(y, z), y, z])


def _posture(points: Array, thumb: Array, side: Side, before: Array) -> tuple[Array, Array]:
    """Generic angles (5,) [rad] with shoulder, elbow and wrist at `points` (3, 3); -axis of flexion (3,).

    Where the elbow is straight that is the one of `before`, or what would bend the forearm forward.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    if not lengths.all():
        raise TciError(f"two joints of the {side} arm are at one place; valid: a skeleton with its offsets")
    upper, fore = steps / lengths
    forward, left = np.eye(3)[:2]
    choices = (np.cross(fore, upper), before - upper * float(before @ upper), np.cross(forward, upper), left)
    across = next(
        one
        for one, least in zip(choices, (STRAIGHT, NONE, NONE, 0.0), strict=True)
        if np.linalg.norm(one) > least
    )
    y = across / np.linalg.norm(across)
    z = -upper
    shoulder = shoulder_angles(np.column_stack([np.cross(y, z), y, z]), side)
    flexion = float(np.arctan2(np.linalg.norm(np.cross(upper, fore)), upper @ fore))
    posture = np.array([*shoulder, flexion, 0.0])
    R_TF = forearm_rotation(posture, side, axial=False)
    seen = R_TF.T @ thumb
    posture[4] = -side_sign(side) * float(np.arctan2(seen[1], seen[0]))
    return posture, y
