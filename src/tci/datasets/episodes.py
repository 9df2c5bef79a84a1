"""Columns of a data set from recordings, at one frame rate for all of them.

Frame i stands for the time first + i / fps. Its row has what was perceived and sent last until then, and the
raw skin frames that came since the row before: their values are not sampled, so nothing of them is lost.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.errors import FrameError, RecordingError
from tci.messages import JointReading, Mode, Perception, Reading, SkinFrame
from tci.recording.perceived import Perceived, perceive, recorded_robot
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import decode
from tci.recording.schemas import SKIN, TICK, mode_number, to_frame, to_nanoseconds
from tci.robot.description import Robot
from tci.robot.joint_map import generic_posture
from tci.robot.like import RobotLike
from tci.skin.surfaces import Surface

STATE, ACTION, WANTED = "observation.state", "action", "action.wanted"
FORCES, CONTACTS, TACTILE = "observation.environment_state", "observation.contacts", "observation.tactile"
RAW, STAMPS, COUNT = "observation.tactile_raw", "observation.tactile_stamp_ns", "observation.tactile_count"
"""Names of the columns; those that begin with TACTILE, RAW, STAMPS and COUNT end in the name of a patch.
Policies such as ACT read STATE, FORCES and pictures only, so FORCES repeats the forces on all taxels."""
HEAD = "observation.images.head"
"""Pictures; their values are those of height, width and three colours."""
STRONGEST = 4
"""Contacts in a row: the strongest; the others are in the forces on the taxels."""
CONTACT = ("x", "y", "z", "force_x", "force_y", "force_z", "area")
"""Values of one contact: point [m] and force [N] in the torso frame, area [m2]. All 0 where there is none."""
BLOCK = 512
"""Rows that are made at a time, so that memory does not grow with the length of a recording."""

POSITIONS = mode_number(Mode.POSITION), mode_number(Mode.IMPEDANCE)
Columns = dict[str, NDArray[Any]]
IMAGE = "image"
FEW = 32
"""Rows with pictures that are made at a time."""


@dataclass(frozen=True, slots=True)
class Pictures:
    """What the head saw, for a set."""

    width: int
    height: int
    of: Callable[[Recording, Robot], Callable[[float, Reading], NDArray[np.uint8]]]
    """For a recording, from the time [s] and the reading of a period to the picture (height, width, 3)."""


@dataclass(frozen=True, slots=True)
class Feature:
    """One column: `size` values of type `dtype` in each row."""

    dtype: str
    size: int
    names: tuple[str, ...] | None = None
    info: dict[str, Any] = field(default_factory=dict)
    shape: tuple[int, ...] = ()
    """Of pictures: height, width and 3."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One recording of a set."""

    recording: Recording
    task: str
    frames: int


@dataclass(frozen=True, slots=True, eq=False)
class DataSet:
    """Recordings of one robot, ready to be written."""

    robot: Robot
    fps: int
    features: dict[str, Feature]
    episodes: tuple[Episode, ...]
    surfaces: dict[str, Surface]
    left_out: tuple[str, ...]
    """What the recordings have and the set has not, a sentence each."""
    pictures: Pictures | None = None

    def blocks(self, episode: Episode) -> Iterator[Columns]:
        """Yields the rows of an episode, at most BLOCK at a time.

        Raises RecordingError if the recording can't be read.
        """
        return _Rows(self).blocks(episode)


def read_set(
    files: Sequence[Path | str],
    *,
    task: str = "",
    fps: int = 30,
    robot: RobotLike | None = None,
    pictures: Pictures | None = None,
) -> DataSet:
    """Reads what the recordings contain, without their values.

    Args:
        files: Recordings.
        task: Text of recordings that have none of their own (`Recorder(about={"task": ...})`).
        fps: Rows per second.
        robot: The robot, if the recordings were made with a description file.
        pictures: What the head saw.

    Raises RecordingError if a recording can't be read, or they are of different robots, and for an `fps`
    below 1.
    """
    if not files:
        raise RecordingError("no recording; valid: a recording (.mcap) or a folder of them")
    recordings = [Recording(file) for file in files]
    found: Robot | None = None
    for recording in recordings:
        one = recorded_robot(recording, robot)
        if one is None:
            raise RecordingError(f"{recording.path} does not name its robot; valid: give it as ROBOT")
        if found is not None and one.digest != found.digest:
            raise RecordingError(
                f"{recording.path} is of {one.name!r}, {recordings[0].path} of {found.name!r}; valid: one "
                "robot per set"
            )
        found = one
    assert found is not None
    if fps < 1:
        raise RecordingError(f"{fps} frames per second; valid: 1 or more")
    clocks = [_Clock.of(recording, fps) for recording in recordings]
    if empty := next((c for c in clocks if c.frames == 0), None):
        raise RecordingError(f"{empty.path} has no periods; valid: a recording of a run")
    features, surfaces, left_out = _features(found, clocks)
    if pictures is not None:
        shape = (pictures.height, pictures.width, 3)
        says = {"says": "drawn from the recorded angles and touches"}
        features[HEAD] = Feature(
            IMAGE, int(np.prod(shape)), ("height", "width", "channels"), says, shape=shape
        )
    return DataSet(
        robot=found,
        fps=fps,
        features=features,
        episodes=tuple(
            Episode(one, one.about.get("task") or task or f"{found.name} is touched", clock.frames)
            for one, clock in zip(recordings, clocks, strict=True)
        ),
        surfaces=surfaces,
        left_out=left_out,
        pictures=pictures,
    )


@dataclass(slots=True)
class _Clock:
    """What the times of a recording say: its number of frames, and per patch the most skin frames in one."""

    path: Path
    fps: int
    first: int | None = None
    frames: int = 0
    samples: dict[str, SkinFrame] = field(default_factory=dict)
    most: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, recording: Recording, fps: int) -> _Clock:
        clock, row = cls(recording.path, fps), -1
        waiting, count = Counter[str](), Counter[str]()
        for topic, kind, stamp, data in recording.messages():
            if kind is SKIN:
                patch = topic.removeprefix("/skin/")
                if patch not in clock.samples:
                    clock.samples[patch] = to_frame(decode(kind, data))
                waiting[patch] += 1
            elif kind is TICK:
                if (at := clock.row(stamp)) > row:
                    row, count = at, Counter()
                count += waiting
                for patch in waiting:
                    clock.most[patch] = max(clock.most.get(patch, 0), count[patch])
                waiting.clear()
        return clock

    def row(self, stamp: int) -> int:
        """Returns the frame to which a period at `stamp` [ns] belongs. Time never runs back."""
        if self.first is None:
            self.first = stamp
        row = -(-(stamp - self.first) * self.fps // 10**9)
        self.frames = max(self.frames, row + 1)
        return self.frames - 1


def _features(
    robot: Robot, clocks: Sequence[_Clock]
) -> tuple[dict[str, Feature], dict[str, Surface], tuple[str, ...]]:
    body = GenericBody(robot)
    joints = tuple(
        f"{part.name}.{servo.name}"
        for part in robot.parts
        for servo, there in zip(part.servos, body.has_joint(part.name), strict=True)
        if there
    )
    about = {"unit": "rad", "description_sha256": robot.digest}
    features = {
        STATE: Feature("float32", len(joints), joints, about),
        ACTION: Feature("float32", len(joints), joints, about | {"says": "angles that the gate sent"}),
        WANTED: Feature("float32", len(joints), joints, about | {"says": "angles that were asked for"}),
        CONTACTS: Feature(
            "float32",
            STRONGEST * len(CONTACT),
            tuple(f"{what}_{k}" for k in range(STRONGEST) for what in CONTACT),
            {"frame": "torso", "units": "m, N, m2"},
        ),
    }
    surfaces, left_out, forces = dict[str, Surface](), list[str](), list[str]()
    for patch in robot.patches:
        samples = [clock.samples[patch.name] for clock in clocks if patch.name in clock.samples]
        if not samples:
            left_out.append(f"patch {patch.name}: it never sent")
            continue
        sent = {(one.values.dtype.str, one.values.size) for one in samples}
        if len(sent) > 1 or samples[0].values.dtype.kind not in "uif":
            left_out.append(f"patch {patch.name}: its values are {sorted(sent)}; valid: numbers of one type")
            continue
        surface = surfaces[patch.name] = body.skin.surfaces[patch.name]
        taxels = tuple(f"{patch.name}.{k}" for k in range(len(surface.areas)))
        forces += taxels
        slots = max(clock.most.get(patch.name, 0) for clock in clocks)
        own: dict[str, Any] = {"link": surface.link, "slots": slots}
        values = samples[0].values
        features |= {
            f"{TACTILE}.{patch.name}": Feature("float32", len(taxels), taxels, own | {"unit": "N"}),
            f"{RAW}.{patch.name}": Feature(
                values.dtype.newbyteorder("=").name,
                slots * values.size,
                None,
                own | {"channels": values.size, "count_feature": f"{COUNT}.{patch.name}"},
            ),
            f"{STAMPS}.{patch.name}": Feature("int64", slots, None, own | {"unit": "ns"}),
            f"{COUNT}.{patch.name}": Feature("int64", 1, None, {"says": "skin frames in this row"}),
        }
    unknown = sorted({name for clock in clocks for name in clock.samples} - {p.name for p in robot.patches})
    left_out += [f"patch {name}: the robot has none of this name" for name in unknown]
    if forces:
        features[FORCES] = Feature("float32", len(forces), tuple(forces), {"unit": "N"})
    return features, surfaces, tuple(left_out)


class _Rows:
    """Makes the rows of one episode."""

    def __init__(self, data: DataSet) -> None:
        self._data = data
        robot = data.robot
        body = GenericBody(robot)
        self._has = {part.name: body.has_joint(part.name) for part in robot.parts}
        self._patches = {
            name: (p, data.surfaces[name].areas)
            for p, name in enumerate(patch.name for patch in robot.patches)
            if name in data.surfaces
        }
        self._sent: NDArray[np.float64] = np.empty(0)
        self._asked: dict[str, NDArray[np.float64]] = {}
        self._seen: dict[str, SkinFrame] = {}
        self._most = BLOCK if data.pictures is None else FEW
        self._sees: Callable[[float, Reading], NDArray[np.uint8]] | None = None

    def blocks(self, episode: Episode) -> Iterator[Columns]:
        clock = _Clock(episode.recording.path, self._data.fps)
        if self._data.pictures is not None:
            self._sees = self._data.pictures.of(episode.recording, self._data.robot)
        block, row = self._empty(min(self._most, episode.frames)), 0
        last: Perceived | None = None
        arrived: dict[str, list[SkinFrame]] = {name: [] for name in self._patches}
        begun = 0
        for period in perceive(episode.recording, self._data.robot):
            at = clock.row(to_nanoseconds(period.now))
            if last is not None and at > row:  # the frames before this period are complete
                values = self._values(last)
                while at > row:
                    self._put(block, row - begun, values, arrived)
                    row += 1
                    if row - begun == len(block[STATE]):
                        yield block
                        begun, block = row, self._empty(min(self._most, episode.frames - row))
            self._follow(period)
            last = period
            for frame in period.reading.skin:
                if frame.patch in arrived and self._seen.get(frame.patch) is not frame:
                    arrived[frame.patch].append(frame)
                self._seen[frame.patch] = frame
        if last is None:
            raise RecordingError(f"{episode.recording.path}: no period fits the robot")
        self._put(block, row - begun, self._values(last), arrived)
        yield {name: values[: row - begun + 1] for name, values in block.items()}

    def _empty(self, rows: int) -> Columns:
        return {
            name: np.zeros((rows, one.size), np.uint8 if one.dtype == IMAGE else one.dtype)
            for name, one in self._data.features.items()
        }

    def _put(self, block: Columns, row: int, values: Columns, arrived: dict[str, list[SkinFrame]]) -> None:
        for name, row_values in values.items():
            block[name][row] = row_values
        for patch, frames in arrived.items():
            block[f"{COUNT}.{patch}"][row] = len(frames)
            for slot, frame in enumerate(frames):
                size = frame.values.size
                raw = block[f"{RAW}.{patch}"][row]
                if frame.values.dtype.newbyteorder("=") != raw.dtype or raw.size < (slot + 1) * size:
                    raise RecordingError(
                        f"{self._data.robot.name}: the frame of {patch} at {frame.stamp} s has {size} values "
                        f"of type {frame.values.dtype}, those before {raw.dtype}; valid: one type and number"
                    )
                raw[slot * size : (slot + 1) * size] = frame.values
                block[f"{STAMPS}.{patch}"][row, slot] = to_nanoseconds(frame.stamp)
            frames.clear()

    def _follow(self, period: Perceived) -> None:
        """Remembers what was sent and asked for."""
        count = len(period.reading.joints.position)
        if len(self._sent) != count:
            self._sent = np.full(count, np.nan)
        if period.decision is not None:
            servos, modes = period.decision["servos"], period.decision["modes"]
            angular = (modes == POSITIONS[0]) | (modes == POSITIONS[1])
            self._sent[servos] = np.where(angular, period.decision["position"], np.nan)
        for order in period.commands:
            if order["kind"] == "GenericCommand" and order["mode"] in ("position", "impedance"):
                self._asked[order["part"]] = order["values"]
            elif order["part"] in self._asked and order["kind"] != "SwitchMode":
                del self._asked[order["part"]]

    def _values(self, period: Perceived) -> Columns:
        joints, seen = period.reading.joints, period.perception
        state = self._flat(seen.posture)
        # the measured angles where none are sent
        action = self._posture(joints, np.where(np.isfinite(self._sent), self._sent, joints.position))
        wanted = {name: values.copy() for name, values in action.items()}
        for part, values in self._asked.items():
            if part in wanted and len(values) == len(wanted[part]):
                wanted[part] = np.where(np.isfinite(values), values, wanted[part])
        found: Columns = {
            STATE: state,
            ACTION: self._flat(action),
            WANTED: self._flat(wanted),
            CONTACTS: self._contacts(seen),
        }
        forces = [period.skin.on(p) * areas for p, areas in self._patches.values()]
        found |= {f"{TACTILE}.{name}": one for name, one in zip(self._patches, forces, strict=True)}
        if forces:
            found[FORCES] = np.concatenate(forces)
        if self._sees is not None:
            found[HEAD] = self._sees(period.now, period.reading).ravel()
        return found

    def _posture(self, joints: JointReading, angles: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        try:
            return dict(generic_posture(self._data.robot, replace(joints, position=angles)))
        except FrameError as error:
            raise RecordingError(str(error)) from error

    def _flat(self, posture: Any) -> NDArray[np.float64]:
        return np.concatenate([posture[part][has] for part, has in self._has.items()] or [np.empty(0)])

    @staticmethod
    def _contacts(seen: Perception) -> NDArray[np.float64]:
        rows = np.zeros((STRONGEST, len(CONTACT)))
        for row, contact in zip(rows, sorted(seen.contacts, key=lambda one: -one.force), strict=False):
            row[:] = *contact.p_T, *contact.f_T, contact.area
        return rows.ravel()
