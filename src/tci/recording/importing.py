"""Converts a file of another program to a recording. If an error occurs, no recording remains."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import FrameError, RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.recording.recorder import Recorder
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

FROM_FILE = "file"
"""Value of `middleware` in the metadata of a recording that was made from a file of arrays."""
FIRST = 100
"""Number of readings at the start of a file from which TCI estimates the recording's period. The period is
the median of their intervals. Assumed: with fewer readings the period would depend on single delays. With
more readings the import would read farther ahead."""
FARTHEST = 2**63 / 1e9
"""Largest time [s] that a recording can contain: 292 years. Times are stored in nanoseconds. A time since
1970 that is in milliseconds by mistake exceeds this limit."""
LONGEST_LINE = 2**20
"""Longest line [characters] that is read. Assumed: this length limits the memory that a damaged or hostile
file can use."""


BEYOND = 0.2
"""Angle [rad] beyond a joint's limits from which an imported angle is doubted. Assumed: calibration and
elastic joints are off by less."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What became of a file of another program."""

    periods: int
    doubts: tuple[str, ...] = ()
    """What can't be as the file says, a sentence each."""
    left_out: tuple[str, ...] = ()
    """What the file has and the recording has not."""
    joints: bool = False
    """True if the file has the robot's angles; without them its joints are said to rest."""


class Plausibility:
    """Watches imported angles [rad] for what no robot measures."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._missing = np.zeros(len(robot.servos), int)
        self._least = np.full(len(robot.servos), np.inf)
        self._most = -self._least
        self._count = 0

    def see(self, angles: Array) -> None:
        self._count += 1
        self._missing += ~np.isfinite(angles)
        self._least, self._most = np.fmin(self._least, angles), np.fmax(self._most, angles)

    def doubts(self) -> tuple[str, ...]:
        found = []
        for servo, missing, least, most in zip(
            self._robot.servos, self._missing, self._least, self._most, strict=True
        ):
            if missing == self._count:
                found.append(
                    f"{servo.name} is not a number in all {self._count} joint states: in the recording it "
                    "rests at the initial posture"
                )
                continue
            if missing:
                found.append(f"{servo.name} is not a number in {missing} of {self._count} joint states")
            lower = -np.inf if servo.limits.lower is None else servo.limits.lower
            upper = np.inf if servo.limits.upper is None else servo.limits.upper
            worst = most if most - upper > lower - least else least
            if max(most - upper, lower - least) > BEYOND:
                limits = f"limits {lower:.2f} to {upper:.2f}"
                degrees = "; degrees? valid: radians" if abs(worst) > np.pi else ""
                found.append(f"{servo.name} {worst:.1f} rad; {limits}{degrees}")
        return tuple(found)


class Unmeasured:
    """Lets joints that were never measured rest at the initial posture, so that they stop nothing but
    themselves: the gate holds the whole robot for an angle that is not a number."""

    def __init__(self, robot: Robot, first: Sequence[Reading]) -> None:
        """`first` are the readings at the start: what is no number in all of them counts as never measured,
        until it is."""
        self._rest = initial_position(robot)
        self._dead = np.isnan([reading.joints.position for reading in first]).all(axis=0)

    def mend(self, reading: Reading) -> Reading:
        joints = reading.joints
        self._dead &= np.isnan(joints.position)
        if not self._dead.any():
            return reading
        velocity = np.where(self._dead, 0.0, joints.velocity)
        torque = None if joints.torque is None else read_only(np.where(self._dead, 0.0, joints.torque))
        position = read_only(np.where(self._dead, self._rest, joints.position))
        mended = replace(joints, position=position, velocity=read_only(velocity), torque=torque)
        return Reading(mended, reading.skin)


class Importer:
    """Writes imported readings, with the skin as other programs show it if the robot has a model."""

    def __init__(self, recorder: Recorder, robot: Robot | None) -> None:
        self.recorder = recorder
        self._perceiver: Perceiver | None = None
        if robot is not None and robot.model is not None:
            self._perceiver = Perceiver(GenericBody(robot))

    def write(self, reading: Reading) -> None:
        now, perception = reading.joints.stamp, None
        if self._perceiver is not None:
            with suppress(FrameError):  # frames that do not fit are recorded as they are
                perception = self._perceiver.step(reading, now)
        self.recorder.tick(now, reading, perception=perception)


@contextmanager
def importing(
    out: Path, robot: Robot | None, *, middleware: str, source: str, period: float = 0.0
) -> Iterator[Importer]:
    """Opens a recording. Deletes the file if the `with` block raises an error or the disk is full.

    Raises RecordingError if the file exists or can't be written.
    """
    recorder = Recorder(out, robot, middleware=middleware, period=period, about={"source": source})
    try:
        with recorder:
            yield Importer(recorder, robot)
        if recorder.failed:
            raise RecordingError(recorder.failed)
    except BaseException:
        out.unlink(missing_ok=True)
        raise


def import_frames(
    frames: Iterable[tuple[SkinFrame, ...]], out: Path, robot: Robot | None, *, middleware: str, source: str,
    twice: bool = False,
) -> int:  # fmt: skip
    """Writes a recording that contains only skin frames.

    Returns the number of periods, which is the number of items in `frames`. If `robot` is given, the recorded
    joints rest at the robot's initial posture, so that the recording can be replayed and drawn. If `twice` is
    True, two successive items may have equal times, since some programs send two messages with one time.
    Raises RecordingError in three cases: there are no frames, the times do not increase, or a frame does not
    fit. With a robot, frames must fit the robot's patches. Without a robot, all frames of a patch must have
    equal sizes.
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
    with importing(out, robot, middleware=middleware, source=source, period=max(period, 0.0)) as importer:
        for number, item in enumerate(chain(first, items)):
            importer.write(Reading(JointReading(item[0].stamp, number, angles, still), item))
    return importer.recorder.ticks


def check_size(frame: SkinFrame, robot: Robot) -> None:
    """Raises RecordingError unless the frame has one value for each channel of its patch."""
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
