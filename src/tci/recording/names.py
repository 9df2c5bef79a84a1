"""Names of files that come from elsewhere: they never leave their folder."""

from __future__ import annotations

import re
from pathlib import Path

from tci.errors import RecordingError

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Letters, digits, _ . and -, not first a dot; so no folder, no drive and no hidden file."""


def inside(folder: Path, name: str) -> Path:
    """The path of `name` in `folder`. Raises RecordingError for a name that could lead elsewhere."""
    if not NAME.fullmatch(name):
        valid = "letters, digits, _ . - (at most 100)"
        raise RecordingError(f"no file may be named {name[:60]!r}; valid: {valid}")
    return folder / name
