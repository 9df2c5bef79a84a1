"""Imports episodes that people recorded while they steered a Unitree robot: Humanoid Everyday,
xr_teleoperate, and the fork of it that stores the 1062 counts of each Inspire hand.

Every name that these formats fix is in this file. None of them writes units or the order of its joints; what
is assumed is told.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.doubts import Streams
from tci.recording.importing import FROM_FILE, Imported, Plausibility, import_frames, importing
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.support.installed import needs

FILE = "data.json"
LARGEST = 2**29
"""Size [bytes] of the largest file that is read, so that a hostile one takes no more memory."""
RATE = 30.0
"""Frames per second where an episode has no times."""
SIDES = ("left", "right")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARMS = tuple(f"{side}_{joint}" for side in SIDES for joint in ARM)
LEGS = (*(f"{side}_{joint}" for side in SIDES for joint in LEG), "waist_yaw", "waist_roll", "waist_pitch")
"""Joints in the order of a G1's motors."""
ORDER = "the order of the joints is not in the file: that of a G1's motors is assumed"
TACTILE = "observation.tactile"
INSPIRE = {
    **{f"{finger}_{end}": size for finger in ("little", "ring", "middle", "index")
       for end, size in (("tip", 9), ("top", 96), ("pad", 80))},
    "thumb_tip": 9, "thumb_top": 96, "thumb_middle": 9, "thumb_pad": 96, "palm": 112,
}  # fmt: skip
"""Counts of an Inspire hand, in their order."""
PADS = 9
"""Pads of one Dex3 hand."""

Array = NDArray[Any]


@dataclass(slots=True)
class _Taken:
    """What was found in an episode."""

    times: Array
    touch: dict[str, Array] = field(default_factory=dict)
    """Values (frames, n) of each patch."""
    joints: dict[str, Array] = field(default_factory=dict)
    """Angles (frames,) [rad] by the name of the joint."""
    doubts: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def take_joints(self, what: str, names: tuple[str, ...], values: Any) -> None:
        table = _numbers(values, len(self.times))
        if table is None or table.shape[1] != len(names):
            found = "no numbers" if table is None else f"{table.shape[1]} values"
            self.left_out.append(f"{what}: {found}; valid: {len(names)} joints")
            return
        self.joints |= dict(zip(names, table.T, strict=True))


def is_teleoperation(path: Path) -> bool:
    return (path / FILE).is_file() or any(path.glob(f"episode_*/{FILE}")) or _is_copy(path)


def _is_copy(path: Path) -> bool:
    """True for the copy of Humanoid Everyday in LeRobot's older format."""
    try:
        info = json.loads((path / "meta" / "info.json").read_text(encoding="utf-8"))
        return str(info["codebase_version"]).lstrip("v").startswith("2.") and TACTILE in info["features"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def import_teleoperation(path: Path, out: Path, episode: int, *, robot: Robot | None) -> Imported:
    """Writes an episode as a recording. `path` is its folder, or that of all episodes of a task.

    Without `robot`, joints are left out. With it, joints that the episode lacks rest at the initial posture.
    Raises RecordingError if the episode can't be read, or neither touch nor joints are left.
    """
    if _is_copy(path):
        return _write(_copy(path, episode), out, robot, source=f"{path.name}, episode {episode}")
    folder = path
    if not (path / FILE).is_file():
        numbers = {_number(file.parent.name): file.parent for file in path.glob(f"episode_*/{FILE}")}
        if episode not in numbers:
            raise RecordingError(f"{path} has no episode {episode}; valid: {sorted(numbers)}")
        folder = numbers[episode]
    try:
        if (folder / FILE).stat().st_size > LARGEST:
            raise RecordingError(f"{folder / FILE}: larger than {LARGEST} bytes")
        found = json.loads((folder / FILE).read_text(encoding="utf-8"))
        taken = _everyday(found) if isinstance(found, list) else _xr(found, folder)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise RecordingError(
            f"{folder / FILE} is no episode of Humanoid Everyday or xr_teleoperate: {error!r}"
        ) from error
    return _write(taken, out, robot, source=f"{folder.parent.name}/{folder.name}")


def _number(name: str) -> int:
    digits = name.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else -1


def _copy(path: Path, episode: int) -> _Taken:
    with needs("data sets of LeRobot", "parquet"):
        import pyarrow as pa
        from pyarrow import parquet
    file = next(path.glob(f"data/*/episode_{episode:06d}.parquet"), None)
    if file is None:
        raise RecordingError(f"{path} has no episode {episode}; valid: those in {path / 'data'}")
    used = ("timestamp", TACTILE, "observation.arm_joints", "observation.leg_joints")
    try:
        names = parquet.read_schema(file).names
        table = parquet.read_table(file, columns=[name for name in used if name in names]).to_pydict()
        taken = _Taken(np.array(table["timestamp"], float).ravel())
        touch = np.array(table[TACTILE], float)  # (frames, pads, values)
        pads = touch.shape[1] if touch.ndim == 3 else 0
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise RecordingError(f"{file} can't be read: {error}") from error
    for name, joints in zip(used[2:], (ARMS, LEGS), strict=True):
        taken.take_joints(name, joints, table.get(name, []))
    taken.doubts.append(ORDER)
    taken.touch = {f"pad_{pad}": touch[:, pad] for pad in range(pads)}
    _doubt_pads(taken, pads)
    taken.left_out += [name for name in names if name not in used]
    return taken


def _doubt_pads(taken: _Taken, count: int) -> None:
    if count:
        taken.doubts.append("pads are counts; which is where on which hand is not in the file")
    if count == PADS:
        taken.doubts.append(f"{PADS} pads, and two hands have {2 * PADS}: one of two hands")


def _everyday(frames: list[dict[str, Any]]) -> _Taken:
    """Humanoid Everyday: a list of frames, with the time of each."""
    states = [frame["states"] for frame in frames]
    taken = _Taken(np.array([float(frame["time"]) for frame in frames]))
    taken.take_joints("states.arm_state", ARMS, [state.get("arm_state") for state in states])
    taken.take_joints("states.leg_state", LEGS, [state.get("leg_state") for state in states])
    taken.doubts.append(ORDER)
    pads = [state.get("hand_pressure_state") or [] for state in states]
    count = len(pads[0]) if pads else 0
    if any(len(one) != count for one in pads):
        raise RecordingError(
            f"hand_pressure_state has {sorted({len(one) for one in pads})} pads; valid: one number"
        )
    for pad in range(count):
        values = _numbers([one[pad]["usable_readings"] for one in pads], len(frames))
        if values is None:
            taken.left_out.append(f"states.hand_pressure_state {pad}: no numbers")
        else:
            taken.touch[f"pad_{pad}"] = values
    _doubt_pads(taken, count)
    used = {"arm_state", "leg_state", "hand_pressure_state"}
    taken.left_out += [f"states.{name}" for name in states[0] if name not in used] if states else []
    taken.left_out += [name for name in frames[0] if name not in ("states", "time")] if frames else []
    return taken


def _xr(found: dict[str, Any], folder: Path) -> _Taken:
    """xr_teleoperate: frames without times; `tactiles` is null but in the fork, where it names files."""
    frames = found["data"]
    rate = float((found.get("info", {}).get("image") or {}).get("fps") or RATE)
    if not 0.1 <= rate <= 1000.0:
        raise RecordingError(f"{rate} frames per second; valid: 0.1 to 1000")
    taken = _Taken(np.arange(len(frames)) / rate)
    taken.doubts.append(f"frames have no time: {rate:g} per second are assumed")
    for side in SIDES:
        names = tuple(f"{side}_{joint}" for joint in ARM)
        values = [frame["states"].get(f"{side}_arm", {}).get("qpos") for frame in frames]
        taken.take_joints(f"states.{side}_arm.qpos", names, values)
        _counts(taken, side, frames, folder)
    for name in frames[0]["states"] if frames else ():
        if not name.endswith("_arm"):
            taken.left_out.append(f"states.{name}: its unit is not in the file")
    taken.left_out += (
        [name for name in frames[0] if name not in ("idx", "states", "tactiles")] if frames else []
    )
    return taken


def _counts(taken: _Taken, side: str, frames: list[dict[str, Any]], folder: Path) -> None:
    key = f"{side}_tactile"
    paths = [(frame.get("tactiles") or {}).get(key) for frame in frames]
    if not any(paths):
        taken.left_out.append(f"tactiles.{key}: null in all frames, as xr_teleoperate itself writes it")
        return
    size, rows = sum(INSPIRE.values()), list[Array]()
    for path in paths:
        one = _load(folder, path) if path else None
        if one is not None and one.size != size:
            raise RecordingError(f"{folder / str(path)}: {one.size} counts; valid: {size}")
        rows.append(np.full(size, np.nan) if one is None else one.ravel())
    missing = sum(path is None for path in paths)
    if missing:
        taken.doubts.append(f"tactiles.{key}: missing in {missing} of {len(frames)} frames")
    values, begin = np.stack(rows), 0
    for name, many in INSPIRE.items():
        taken.touch[f"{side}_{name}"] = values[:, begin : begin + many]
        begin += many


def _load(folder: Path, name: str) -> Array:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise RecordingError(f"{name!r} leads out of {folder}; valid: a file in this folder")
    if path.stat().st_size > LARGEST:
        raise RecordingError(f"{path}: larger than {LARGEST} bytes")
    array: Array = np.load(path, allow_pickle=False)
    if array.dtype.kind not in "uif":
        raise RecordingError(f"{path}: {array.dtype}; valid: numbers")
    return array


def _numbers(rows: list[Any], frames: int) -> Array | None:
    """Returns a table (frames, n); shorter rows are filled up with NaN. None if there are no numbers."""
    if not rows or not all(isinstance(row, list) and row for row in rows):
        return None
    size = max(map(len, rows))
    table = np.full((frames, size), np.nan)
    for line, row in zip(table, rows, strict=True):
        line[: len(row)] = [np.nan if value is None else float(value) for value in row]
    return table


def _write(taken: _Taken, out: Path, robot: Robot | None, *, source: str) -> Imported:
    streams = Streams()
    touch = {patch: streams.see(patch, values) for patch, values in taken.touch.items()}
    touch = {patch: values for patch, values in touch.items() if values.shape[1]}
    finite = np.where(np.isfinite(taken.times), taken.times, -np.inf)
    later = finite > np.concatenate([[-np.inf], np.maximum.accumulate(finite)[:-1]])
    if not later.all():
        many = int((~later).sum())
        taken.doubts.append(f"{many} of {len(later)} frames are no later than one before, and are left out")
    rows = np.flatnonzero(later)
    if robot is None:
        if taken.joints:
            taken.left_out.append("all joints: to keep them, name the robot")
        items = (_frames(touch, float(taken.times[row]), int(row)) for row in rows)
        if not touch:
            raise RecordingError(f"{source} has no touch; valid: name the robot, to import its joints")
        periods = import_frames(items, out, None, middleware=FROM_FILE, source=source)
        return Imported(periods, (*taken.doubts, *streams.doubts()), tuple(taken.left_out))
    for patch in [*touch]:
        known = next((one for one in robot.patches if one.name == patch), None)
        if known is None or known.channels != touch[patch].shape[1]:
            why = "no such patch" if known is None else f"{known.channels} channels there"
            taken.left_out.append(f"{patch}: {why} on {robot.name}")
            del touch[patch]
    angles = _angles(taken, robot)
    if not touch and not len(taken.joints):
        raise RecordingError(f"{source} has neither touch nor joints of {robot.name}")
    plausible, still = Plausibility(robot), np.zeros(len(robot.servos))
    period = float(np.median(np.diff(taken.times[rows]))) if len(rows) > 1 else 0.0
    with importing(out, robot, middleware=FROM_FILE, source=source, period=max(period, 0.0)) as importer:
        for row in rows:
            now = float(taken.times[row])
            plausible.see(angles[row])
            joints = JointReading(now, int(row), angles[row], still)
            importer.write(Reading(joints, _frames(touch, now, int(row))))
    doubts = (*taken.doubts, *plausible.doubts(), *streams.doubts())
    return Imported(importer.recorder.ticks, doubts, tuple(taken.left_out), joints=bool(taken.joints))


def _frames(touch: dict[str, Array], now: float, row: int) -> tuple[SkinFrame, ...]:
    return tuple(SkinFrame(patch, now, row, values[row]) for patch, values in touch.items())


def _angles(taken: _Taken, robot: Robot) -> Array:
    """Angles (frames, servos); those of joints that were never measured are of the initial posture."""
    angles = np.tile(initial_position(robot), (len(taken.times), 1))
    absent, names = (
        list[str](),
        {servo.name.removesuffix("_joint"): k for k, servo in enumerate(robot.servos)},
    )
    for name, place in names.items():
        values = taken.joints.pop(name, None)
        if values is None or not np.isfinite(values).any():
            absent.append(name)
        else:
            angles[:, place] = values
    taken.left_out += [f"joint {name}: {robot.name} has none of this name" for name in taken.joints]
    taken.joints = {name: angles[:, k] for name, k in names.items() if name not in absent}
    if absent:
        taken.doubts.append(f"never measured, at the initial posture: {', '.join(absent)}")
    return angles
