"""Names in a recording: of servos, told apart; of files that come from elsewhere, kept in their folder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tci.errors import RecordingError
from tci.robot.description import Robot

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Letters, digits, _ . and -, not first a dot; so no folder, no drive and no hidden file."""


def servo_names(robot: Robot) -> list[str]:
    """A name for each servo, no two the same: its own, or `robot_part.name` where others have it too."""
    count = Counter(servo.name for servo in robot.servos)
    return distinct([s.name if count[s.name] == 1 else f"{s.robot_part}.{s.name}" for s in robot.servos])


def distinct(names: Sequence[str]) -> list[str]:
    """The names; all with their places in front, `0.name`, where two are the same."""
    if len(set(names)) == len(names):
        return list(names)
    return [f"{place}.{name}" for place, name in enumerate(names)]


def inside(folder: Path, name: str) -> Path:
    """The path of `name` in `folder`. Raises RecordingError for a name that could lead elsewhere."""
    if not NAME.fullmatch(name):
        valid = "letters, digits, _ . - (at most 100)"
        raise RecordingError(f"no file may be named {name[:60]!r}; valid: {valid}")
    return folder / name
