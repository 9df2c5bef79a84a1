"""Imports logs of YARP's yarpdatadumper. A log contains one line per message: `sequence stamp values...`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from tci.errors import RecordingError
from tci.messages import SkinFrame
from tci.messages.frames import read_only
from tci.recording.doubts import Streams
from tci.recording.importing import FIRST, LONGEST_LINE, Imported, import_frames
from tci.robot.description import Robot

DELAY = 10.0
"""Longest time [s] between sending and receiving a message that was logged. Assumed."""


def log_file(log: Path) -> Path:
    """Returns the file of a log.

    If `log` is a folder of the dumper, the file is its `data.log`, otherwise `log` itself.
    """
    return log / "data.log" if log.is_dir() else log


def is_text(log: Path) -> bool:
    """Returns True if the file's beginning contains no zero byte, as in a text file. Binary files contain
    zero bytes there."""
    with log_file(log).open("rb") as file:
        return b"\0" not in file.read(1024)


def is_contact_list(log: Path) -> bool:
    """Returns True if the log contains contact lists of skinManager.

    In such a log, the first message with values is a list of lists instead of a list of numbers.
    """
    stamped = False
    with log_file(log).open(encoding="utf-8", errors="replace") as file:
        while line := file.readline(LONGEST_LINE):
            if len(line.split(None, 2)) == 3:
                return "(" in line
            stamped = stamped or not line.isspace()
    return stamped  # a log with stamps only: a contact list of a skin that nobody touched


def read_yarp_log(log: Path, *, patch: str) -> Iterator[SkinFrame]:
    """Yields the frames of a log of numbers at the log's own times [s].

    `log` is the file `data.log` or its folder. If a line contains anything but numbers, for example a contact
    list, raises RecordingError with the line's number.
    """
    path = log_file(log)
    with path.open(encoding="utf-8", errors="replace") as file:
        number = 0
        while line := file.readline(LONGEST_LINE + 1):
            number += 1
            if len(line) > LONGEST_LINE:
                raise RecordingError(f"{path}, line {number}: longer than {LONGEST_LINE} characters")
            if line.strip():
                yield _frame(line, patch, f"{path}, line {number}")


def _frame(line: str, patch: str, where: str) -> SkinFrame:
    words = line.split()
    try:
        if "_" in line:  # Python's `float` accepts 1_0 as 10
            raise ValueError
        sequence, stamp = int(words[0]), float(words[1])
        values = read_only([float(word) for word in words[2:]])
    except (ValueError, IndexError):
        text = " ".join(words)[:60]
        raise RecordingError(f"{where}: {text!r}; valid: sequence, stamp [s] and numbers") from None
    if not (np.isfinite(stamp) and len(values) and 0 <= sequence < 2**63):
        valid = "at least one, a finite time"
        raise RecordingError(f"{where}: {len(values)} values at {stamp} s; valid: {valid}")
    return SkinFrame(patch, stamp, sequence, values)


def import_yarp_log(log: Path, out: Path, *, patch: str, robot: Robot | None = None) -> Imported:
    """Converts a log of numbers to a recording.

    If no robot is given, the recording can be viewed and exported, but not replayed. Raises RecordingError if
    the log can't be read or is not of the patch `patch`.
    """
    frames = read_yarp_log(log, patch=patch)
    first = list(islice(frames, FIRST))
    twice = bool(first) and all(map(_has_second_stamp, first))
    every = (
        (replace(frame, values=read_only(frame.values[1:])) if twice else frame,)
        for frame in chain(first, frames)
    )
    streams, source = Streams(chosen=True), f"yarpdatadumper {log.name}"
    periods = import_frames(streams.watch(every), out, robot, middleware="yarp", source=source)
    left_out = ("the second time of each line: the dumper wrote two",) if twice else ()
    return Imported(periods, streams.doubts(), left_out)


def _has_second_stamp(frame: SkinFrame) -> bool:
    """True if the first value is a time, as the dumper writes with the options txTime and rxTime: both are
    seconds since 1970, and no sensor counts so high."""
    return len(frame.values) > 1 and frame.stamp > 1e8 and bool(abs(frame.values[0] - frame.stamp) < DELAY)
