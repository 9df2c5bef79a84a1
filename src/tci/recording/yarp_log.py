"""Logs of YARP's yarpdatadumper: a line per message, `sequence stamp values...`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tci.errors import RecordingError
from tci.frames import read_only
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.recorder import Recorder

LONGEST = 2**20
"""Longest line [characters] that is read."""


def read_yarp_log(log: Path, *, patch: str) -> Iterator[SkinFrame]:
    """The frames of a log of numbers, `data.log` or the folder that it lies in, with its own times [s].

    Raises RecordingError that names the line for anything else, a contact list for example.
    """
    path = log / "data.log" if log.is_dir() else log
    with path.open(encoding="utf-8", errors="replace") as file:
        number = 0
        while line := file.readline(LONGEST + 1):
            number += 1
            if len(line) > LONGEST:
                raise RecordingError(f"{path}, line {number}: longer than {LONGEST} characters")
            if line.strip():
                yield _frame(line.split(), patch, f"{path}, line {number}")


def _frame(words: list[str], patch: str, where: str) -> SkinFrame:
    try:
        sequence, stamp = int(words[0]), float(words[1])
        values = read_only([float(word) for word in words[2:]])
    except (ValueError, IndexError):
        text = " ".join(words)[:60]
        raise RecordingError(f"{where}: {text!r}; valid: sequence, stamp [s] and numbers") from None
    if not (np.isfinite(stamp) and len(values) and 0 <= sequence < 2**63):
        valid = "at least one, a finite time"
        raise RecordingError(f"{where}: {len(values)} values at {stamp} s; valid: {valid}")
    return SkinFrame(patch, stamp, sequence, values)


def import_yarp_log(log: Path, out: Path, *, patch: str) -> int:
    """Make a recording of such a log; the number of frames. It has no joints, so no robot replays it.

    Raises RecordingError.
    """
    frames = read_yarp_log(log, patch=patch)
    first = next(frames, None)
    if first is None:
        raise RecordingError(f"{log} is empty; valid: at least one line")
    none = np.empty(0)
    about = {"source": f"yarpdatadumper {log.name}"}
    with Recorder(out, None, middleware="yarp", about=about) as recorder:
        for frame in (first, *frames):
            joints = JointReading(frame.stamp, frame.sequence, none, none)
            recorder.tick(frame.stamp, Reading(joints, (frame,)))
    if recorder.failed:
        raise RecordingError(recorder.failed)
    return recorder.ticks
