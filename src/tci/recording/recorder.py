"""Writes a recording while the robot runs. Every period is in the file, compressed, before the next begins.

So a killed process loses at most the period that it was writing, and closing only adds the index. If the disk
fails, the recording ends, but the control loop continues.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Self

import tci
from tci.errors import RecordingError, TciError
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Order, Perception, Reading, SkinFrame
from tci.messages.frames import Array
from tci.recording.clouds import Clouds
from tci.recording.growing import GrowingMcap
from tci.recording.names import servo_names
from tci.recording.schemas import (
    CLOUD,
    COMMAND,
    DECISION,
    FORMAT,
    IMU,
    JOINTS,
    SKIN,
    TICK,
    TRUTH,
    command_bytes,
    decision_bytes,
    imu_bytes,
    joints_bytes,
    skin_bytes,
    tick_bytes,
    to_nanoseconds,
    truth_bytes,
)
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot

OF_THIS_MACHINE: Any = {"source": True, "model": {"path"}, "patches": {"__all__": {"surface": {"file"}}}}
"""Fields of a description that contain local paths. These fields are not recorded, as recordings may be
published."""
PACKAGES = ("tci", "numpy", "mujoco", "ruckig", "numba", "mcap")
"""Packages whose versions a recording contains. The version of Python is also recorded."""

SUFFIX = ".mcap"
"""How the name of a recording ends: viewers choose a format by it."""


class Recorder:
    """Writes one recording."""

    def __init__(
        self,
        path: Path | str,
        robot: RobotLike | None,
        *,
        middleware: str = "sim",
        period: float = 0.0,
        keep_alive: float | None = None,
        about: Mapping[str, str] | None = None,
    ) -> None:
        """Creates a new file.

        `about` is added to the file's metadata, for example the capability, its settings, and the seed.
        If the driver sends a frame only when its values change, `keep_alive` [s] is the longest time between
        two frames of a patch. Raises RecordingError if the name does not end in .mcap, and if the file
        exists or can't be created.
        """
        if Path(path).suffix.lower() != SUFFIX:
            raise RecordingError(
                f"{path}: a recording is an MCAP file; valid: a name that ends in {SUFFIX}; from it, tci log "
                "export writes tables"
            )
        robot = None if robot is None else as_robot(robot)
        self.path = Path(path)
        self.failed = ""
        """Reason why the recording ended early; empty if it did not."""
        self.ticks = 0
        """Number of periods written."""
        try:
            self._file = GrowingMcap(self.path, library=f"tci {tci.__version__}")
        except FileExistsError:
            raise RecordingError(f"{self.path} exists and is not replaced; valid: a new file name") from None
        except OSError as error:
            raise RecordingError(f"no recording at {self.path}: {error.strerror}") from error
        self._names = servo_names(robot) if robot else []
        self._open = True
        self._numbers: dict[str, int] = {}
        self._frames: dict[str, SkinFrame] = {}
        self._joints: JointReading | None = None
        self._clouds: Clouds | None = None
        if robot is not None and robot.model is not None:
            with suppress(TciError):  # a model that can't be used
                self._clouds = Clouds(robot)  # now, since in the first period it would miss the next ones
        with _Guard(self):
            known = {} if keep_alive is None else {"keep_alive_s": repr(keep_alive)}
            self._file.describe("tci", _metadata(robot, middleware, period, known | dict(about or {})))
            self._file.flush()

    def tick(
        self,
        now: float,
        reading: Reading,
        commands: Sequence[Order] = (),
        sent: SafeCommand | None = None,
        perception: Perception | None = None,
        touching: Mapping[str, Array] = MappingProxyType({}),
    ) -> None:
        """Writes one period of the loop. Errors of the disk are stored in `failed` and not raised.

        With the `perception` of this period, other programs can show the skin: ten times a second its points
        and pressures are written too. `touching` are the poses (7,) of what touches a simulated robot
        (`World.touching`), so that a film can draw it.
        """
        if self.failed or not self._open:
            return
        with _Guard(self):
            stamp = to_nanoseconds(now)
            if self._joints is None or not _same_joints(self._joints, reading.joints):
                self._file.put("/joint_states", JOINTS, stamp, joints_bytes(self._names, reading.joints))
                if reading.joints.gravity is not None or (self._joints and self._joints.gravity is not None):
                    self._file.put("/imu", IMU, stamp, imu_bytes(reading.joints))
            self._joints = reading.joints
            for frame in reading.skin:
                self._skin(frame, stamp)
            patches = [self._numbers[frame.patch] for frame in reading.skin]
            self._file.put("/tci/tick", TICK, stamp, tick_bytes(now, reading.joints, patches))
            for command in commands:
                self._file.put("/tci/command", COMMAND, stamp, command_bytes(now, command))
            if sent is not None:
                self._file.put("/tci/decision", DECISION, stamp, decision_bytes(sent))
            if touching:
                self._file.put("/tci/truth", TRUTH, stamp, truth_bytes(now, touching))
            if perception is not None and self._clouds is not None:
                cloud = self._clouds.draw(now, perception)
                if cloud is not None:
                    self._file.put("/skin/points", CLOUD, stamp, cloud)
            self._file.flush()
            self.ticks += 1

    def close(self) -> None:
        """Completes the file with its index. A second call has no effect."""
        if not self._open:
            return
        self._open = False
        if not self.failed:
            with _Guard(self):
                self._file.finish()
        self._file.close()

    def _skin(self, frame: SkinFrame, stamp: int) -> None:
        number = self._numbers.setdefault(frame.patch, len(self._numbers))
        before = self._frames.get(frame.patch)
        if before is None or not _same_frame(before, frame):
            self._file.put(f"/skin/{frame.patch}", SKIN, stamp, skin_bytes(frame, number))
        self._frames[frame.patch] = frame

    def to_json(self) -> dict[str, Any]:
        """Returns facts about the written file as JSON values."""
        return {
            "file": str(self.path),
            "periods": self.ticks,
            "bytes": self.path.stat().st_size,
            "failed": self.failed,
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Guard:
    """Context manager that ends the recording after the last complete period if the disk fails."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, OSError):
            return False
        self._recorder.failed = f"ended early: {self._recorder.path}: {error.strerror or error}"
        self._recorder._file.cut()
        return True


def _same_joints(a: JointReading, b: JointReading) -> bool:
    """Returns True if the JointState and Imu messages of `a` and `b` are equal.

    Other fields of `JointReading` are not compared, since the message Tick records them in every period.
    """
    if a is b:
        return True
    return a.stamp == b.stamp and all(
        (x is None) == (y is None) and (x is None or y is None or x.tobytes() == y.tobytes())
        for x, y in (
            (a.position, b.position),
            (a.velocity, b.velocity),
            (a.torque, b.torque),
            (a.gravity, b.gravity),
        )
    )


def _same_frame(a: SkinFrame, b: SkinFrame) -> bool:
    return a is b or (
        (a.stamp, a.sequence, a.values.dtype) == (b.stamp, b.sequence, b.values.dtype)
        and a.values.tobytes() == b.values.tobytes()
    )


def versions() -> dict[str, str]:
    """Returns the versions of packages and Python, and the kind of machine. With other versions, or on
    another kind of machine, results may not be equal bit for bit."""
    found = {name: str(import_module(name).__version__) for name in PACKAGES}
    return found | {"python": platform.python_version(), "machine": f"{sys.platform} {platform.machine()}"}


def _metadata(
    robot: Robot | None, middleware: str, period: float, about: Mapping[str, str]
) -> dict[str, str]:
    """Returns data about the origin of a recording, as strings."""
    found = {
        "format": str(FORMAT),
        "robot": robot.name if robot else "",
        "description_sha256": robot.digest if robot else "",
        "description": robot.model_dump_json(exclude=OF_THIS_MACHINE) if robot else "",
        "middleware": middleware,
        "period_s": repr(period),
        "begun": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": json.dumps(versions()),
    }
    return found | dict(about)
