"""Names in a recording: unique names of servos, and file names that can't lead out of their folder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tci.errors import RecordingError
from tci.robot.description import Robot

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Pattern of a valid name: letters, digits, _ . and -, without a dot at the start. This excludes folders,
drives and hidden files."""


def servo_names(robot: Robot) -> list[str]:
    """Returns a unique name for each servo.

    The unique name is the servo's name, or `robot_part.name` if several servos have this name.
    """
    count = Counter(servo.name for servo in robot.servos)
    return distinct([s.name if count[s.name] == 1 else f"{s.robot_part}.{s.name}" for s in robot.servos])


def distinct(names: Sequence[str]) -> list[str]:
    """Returns the names unchanged if all are different.

    Otherwise returns each name with its index in front, as in `0.name`.
    """
    if len(set(names)) == len(names):
        return list(names)
    return [f"{place}.{name}" for place, name in enumerate(names)]


def inside(folder: Path, name: str) -> Path:
    """Returns the path of `name` in `folder`.

    Raises RecordingError for a name that could lead out of the folder.
    """
    if not NAME.fullmatch(name):
        valid = "letters, digits, _ . - (at most 100)"
        raise RecordingError(f"no file may be named {name[:60]!r}; valid: {valid}")
    return folder / name
