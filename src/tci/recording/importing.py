"""Converts a file of another program to a recording, completely or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path

import numpy as np

from tci.errors import RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.recorder import Recorder
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

FIRST = 100
"""Number of first readings whose median interval is the period of a recording. Assumed; fewer depend on
single delays, more read further ahead."""
FARTHEST = 2**63 / 1e9
"""Largest time [s] that a recording can hold, in nanoseconds: 292 years. Milliseconds since 1970, taken for
seconds, are beyond it."""
LONGEST_LINE = 2**20
"""Longest line [characters] that is read. Assumed: bounds the memory for a damaged or hostile file."""


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


def import_frames(
    frames: Iterable[tuple[SkinFrame, ...]], out: Path, robot: Robot | None, *, middleware: str, source: str,
    twice: bool = False,
) -> int:  # fmt: skip
    """Writes a recording of skin frames alone and returns the number of its periods, one for each item.

    With a robot its joints rest at their initial posture, so that the recording can be replayed and drawn.
    If a time may occur `twice`, the sender repeats that of its own input. Raises RecordingError for no
    frames, times that do not rise, and frames that are not of the robot's patches or, without a robot, not of
    one size.
    """
    items = _checked(frames, robot, twice=twice)
    first = list(islice(items, FIRST))
    if not first:
        raise RecordingError(f"{source} is empty; valid: at least one frame")
    period = float(np.median(np.diff([item[0].stamp for item in first]))) if len(first) > 1 else 0.0
    angles = np.empty(0) if robot is None else initial_position(robot)
    still = np.zeros(len(angles))
    if robot is not None:
        source += ", joints at the initial posture"
    with importing(out, robot, middleware=middleware, source=source, period=max(period, 0.0)) as recorder:
        for number, item in enumerate(chain(first, items)):
            stamp = item[0].stamp
            recorder.tick(stamp, Reading(JointReading(stamp, number, angles, still), item))
    return recorder.ticks


def check_size(frame: SkinFrame, robot: Robot) -> None:
    """Raises RecordingError unless a frame has one value for each channel of its patch."""
    patch = robot.patch(frame.patch)
    if len(frame.values) != patch.channels:
        raise RecordingError(
            f"{len(frame.values)} values at {frame.stamp} s; "
            f"valid: the {patch.channels} channels of {patch.name} of {robot.name}"
        )


def _checked(
    frames: Iterable[tuple[SkinFrame, ...]], robot: Robot | None, *, twice: bool
) -> Iterator[tuple[SkinFrame, ...]]:
    last, sizes = -np.inf, dict[str, int]()
    for item in frames:
        stamp = item[0].stamp
        if not abs(stamp) < FARTHEST:
            raise RecordingError(
                f"a frame at {stamp} s; valid: less than {FARTHEST:.0f} s; is its unit seconds?"
            )
        if stamp < last or (stamp == last and not twice):
            valid = "not earlier" if twice else "later"
            raise RecordingError(
                f"a frame at {stamp} s after one at {last} s; valid: {valid} than the one before"
            )
        for frame in item:
            found = len(frame.values)
            size = sizes.setdefault(frame.patch, max(found, 1))
            if robot is not None:
                check_size(frame, robot)
            elif found != size:
                raise RecordingError(
                    f"{found} values at {stamp} s; valid: the {size} of the first frame, not 0"
                )
        last = stamp
        yield item
