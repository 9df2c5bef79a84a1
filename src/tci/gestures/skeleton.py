"""The skeleton of a BVH file (Biovision hierarchy): its bones, and how they stand in each frame."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tci.gestures.rows import Lines, read_rows
from tci.messages.frames import Array
from tci.robot.xml.document import refuse, shown
from tci.robot.xml.values import InvalidValueError, decimal

BONES = 250
"""Largest number of joints of a skeleton. Assumed: a skeleton with all fingers has about 60 joints."""
CHANNELS = tuple(f"{axis}{what}" for what in ("position", "rotation") for axis in "XYZ")
FORM = "ROOT, JOINT, End Site, OFFSET, CHANNELS, { }"


@dataclass(slots=True)
class Bone:
    """A joint of the skeleton in the file."""

    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()
    first: int = 0

    @property
    def moved(self) -> list[int]:
        """Columns of its position channels in a frame."""
        return [self.first + k for k, channel in enumerate(self.channels) if channel.endswith("position")]


def read_skeleton(source: str, lines: Lines) -> tuple[list[Bone], float, Array]:
    """Returns the content of a BVH file: its bones, the time [s] between frames, and the values of all
    channels (frames, channels)."""
    bones: list[Bone] = []
    stack: list[int] = []
    current, channels = -1, 0
    end_site = False
    taken: set[str] = set()
    start = next(
        (at for at, (_, line) in enumerate(lines) if line.split()[0].upper() == "MOTION"), len(lines)
    )
    pieces = ((number, piece.split()) for number, line in lines[:start] for piece in re.split("([{}])", line))
    for number, words in pieces:
        kind = words[0].upper() if words else "HIERARCHY"
        if kind == "HIERARCHY":
            continue
        if kind in ("ROOT", "JOINT") and len(words) >= 2:
            name = " ".join(words[1:])
            if len(bones) == BONES or name in taken:
                reason = f"second joint {shown(name)}" if name in taken else "too large"
                raise refuse(source, number, f"{reason}; valid: at most {BONES} joints, each of its own name")
            taken.add(name)
            bones.append(Bone(name, stack[-1] if stack else -1, np.zeros(3)))
            current = len(bones) - 1
        elif kind == "END":
            end_site = True
        elif kind == "{":
            stack.append(current)
        elif kind == "}" and stack:
            stack.pop()
            end_site = False
        elif kind == "OFFSET" and len(words) == 4:
            if not end_site and bones:
                bones[current].offset = np.array([_number(source, word, number) for word in words[1:]])
        elif kind == "CHANNELS" and bones:
            names = tuple(word.capitalize() for word in words[2:])
            if words[1:2] != [str(len(names))] or len({*names} & {*CHANNELS}) != len(names):
                found = shown(" ".join(words[1:]))
                valid = f"{', '.join(CHANNELS)}, each once, after their number"
                raise refuse(source, number, f"channels {found}; valid: {valid}")
            bones[current].channels, bones[current].first = names, channels
            channels += len(names)
        else:
            raise refuse(source, number, f"{words[0][:20]!r}; valid: {FORM}")
    if start == len(lines) or not channels:
        raise refuse(source, 0, "no HIERARCHY with CHANNELS and a MOTION after it; valid: a BVH file")
    declared, period = (
        _after(source, lines, start + number, key) for number, key in ((1, "Frames"), (2, "Frame Time"))
    )
    rows = read_rows(source, lines[start + 3 :], channels, mark=None)
    line = lines[start + 1][0]
    if not 0.0 < declared <= len(rows):
        raise refuse(
            source, line, f"{declared:g} frames, of which {len(rows)} are there; valid: a whole file"
        )
    if len(rows) < 2 or not 0.0 < period < 10.0:
        raise refuse(source, line, f"{len(rows)} frames of {period} s; valid: 2 or more, each above 0 s")
    return bones, period, rows


def _after(source: str, lines: Lines, at: int, key: str) -> float:
    """Returns the number after `key:` in the line of the index `at`."""
    line, text = lines[at] if at < len(lines) else (lines[-1][0], "")
    found, mark, word = text.partition(":")
    if not mark or found.lower().split() != key.lower().split() or len(word.split()) != 1:
        raise refuse(source, line, "valid after MOTION: 'Frames: N' and 'Frame Time: SECONDS'")
    return _number(source, word.split()[0], line)


def _number(source: str, word: str, line: int) -> float:
    try:
        return decimal(word)
    except InvalidValueError as error:
        raise refuse(source, line, f"{word[:20]!r}; valid: {error}") from None


def use_positions(bones: list[Bone], frames: Array) -> list[str]:
    """Prepares the offsets of all joints but the root for adding the values of their position channels, and
    tells how these channels are used.

    In most programs, the values replace the OFFSET; in some, they are added to it. They are added if this
    leaves the bones nearer to the lengths in the hierarchy.
    """
    moved = [bone for bone in bones if bone.parent >= 0 and bone.moved]
    if not moved:
        return []
    sizes = [float(np.linalg.norm(np.median(frames[:, bone.moved], axis=0))) for bone in moved]
    if sum(sizes) < 0.5 * sum(float(np.linalg.norm(bone.offset)) for bone in moved):
        return [f"position channels of {len(moved)} joints, added to OFFSET since they are small"]
    for bone in moved:
        for column in bone.moved:
            bone.offset["XYZ".index(bone.channels[column - bone.first][0])] = 0.0
    return [f"position channels of {len(moved)} joints, in place of OFFSET"]


def pose(bones: list[Bone], frames: Array) -> tuple[Array, Array]:
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
        place = np.repeat(bone.offset[None], len(frames), axis=0)
        for column in bone.moved:
            axis = "XYZ".index(bone.channels[column - bone.first][0])
            place[:, axis] += frames[:, column]
        if bone.parent >= 0:
            base = rotations[:, bone.parent]
            place = places[:, bone.parent] + np.einsum("kij,kj->ki", base, place)
            rotation = base @ rotation
        places[:, number], rotations[:, number] = place, rotation
    return rotations, places
