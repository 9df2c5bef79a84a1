"""Converts a file of another program to a recording, completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tci.errors import RecordingError
from tci.recording.recorder import Recorder
from tci.robot.description import Robot


@contextmanager
def importing(
    out: Path, robot: Robot | None, *, middleware: str, source: str, period: float = 0.0
) -> Iterator[Recorder]:
    """Opens a recording that is deleted if the block raises or the disk is full.

    Raises RecordingError if the file exists or can't be written.
    """
    recorder = Recorder(out, robot, middleware=middleware, period=period, about={"source": source})
    try:
        with recorder:
            yield recorder
        if recorder.failed:
            raise RecordingError(recorder.failed)
    except BaseException:
        out.unlink(missing_ok=True)
        raise
