"""Copies a time span of a recording."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from tci.errors import RecordingError
from tci.recording.growing import GrowingMcap
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import MessageType
from tci.recording.schemas import JOINTS, SKIN, TICK, to_nanoseconds


def cut(
    source: Path,
    target: Path,
    *,
    begin: float = -np.inf,
    end: float = np.inf,
    about: Mapping[str, str] | None = None,
) -> None:
    """Writes a recording again, from `begin` to `end` [s]. One whose end is missing becomes whole.

    `target` may be the file `source` itself. The latest joints and skin frames before `begin` are repeated at
    the start of the new file. On any error the file `source` stays unchanged. Raises RecordingError if the
    disk fails or the recording can't be read.
    """
    part = target.with_name(target.name + ".part")
    recording = Recording(source)
    try:
        file = GrowingMcap(part, library="tci")
    except FileExistsError:
        raise RecordingError(f"{part} is in the way: another program writes it, or was killed") from None
    except OSError as error:
        raise RecordingError(f"{target}: {error.strerror or error}") from error
    try:
        try:
            file.describe("tci", recording.about | dict(about or {}))
            _copy(recording, file, begin, end)
            file.finish()
        finally:
            file.close()
        os.replace(part, target)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            raise RecordingError(f"{target}: {error.strerror or error}") from error
        raise


def _copy(recording: Recording, file: GrowingMcap, begin: float, end: float) -> None:
    first = to_nanoseconds(begin) if np.isfinite(begin) else 0
    last = to_nanoseconds(end) if np.isfinite(end) else 2**63
    before: dict[str, tuple[MessageType, bytes]] = {}
    started = False
    for topic, kind, stamp, data in recording.messages():
        if stamp < first:
            if kind in (JOINTS, SKIN):
                before[topic] = kind, data
        elif stamp < last:
            if not started:
                for earlier, (of_kind, known) in before.items():
                    file.put(earlier, of_kind, first, known)
                started = True
            file.put(topic, kind, stamp, data)
            if kind is TICK:
                file.flush()
