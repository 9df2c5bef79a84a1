"""Writes and reads sets in the form of Open-X-Tactile, as FTP-1 trains on it: one Zarr store of format 2, in
which the frames of all episodes follow each other.

Every name that the form fixes is in this file. It knows the areas of two hands; `AREAS` proposes what other
skin could have.
"""

from __future__ import annotations

import json
import re
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.datasets.episodes import ACTION, COUNT, HEAD, RAW, STAMPS, STATE, TACTILE, Columns, DataSet
from tci.datasets.new_folder import new_folder
from tci.datasets.raw_skin import skin_frames
from tci.datasets.zarr2 import ArrayWriter, ZarrArray, make_group, put_array
from tci.errors import RecordingError
from tci.messages import SkinFrame
from tci.recording.doubts import Streams
from tci.recording.importing import FROM_FILE, Imported, import_frames
from tci.robot.description import Robot
from tci.robot.description.patch import Grid, Patch
from tci.robot.generic_fingers import FINGERS, JOINTS, PALM

SUFFIX = ".zarr"
SIDES = ("left", "right")
TIPS = dict(zip(FINGERS, range(5), strict=True))
PALM_AREA = 5
LOWER = dict(zip(FINGERS, range(6, 11), strict=True))
"""Areas below the tip: of the thumb its lower part, of the others the middle segment."""
BELOW_TIP = ("pad", "middle")
"""Ends of the names of patches that lie below the tip of a finger."""
AREAS = {"arm": 21, "body": 22, "leg": 23}
"""Areas of skin that is on no hand: a proposal. The form leaves these codes free; those above are the left
hand's."""
SLOTS = dict(zip(JOINTS, (1, 2, 6, 7, 11, 12, 16, 17, 21, 22), strict=True))
"""Place of each generic finger joint among the 32 of a hand: its spread, and the first of its bends."""
GRIPPER = 28
"""Place that a hand without joints fills, since a side without joints is dropped with all its touch."""
MOST = {"arm": 7, "supplementary": 15}
WORDS = 100
"""Characters of an instruction. Longer ones are cut by the form, so they are told."""
PICTURE, HEAD_PICTURE = "camera_main_rgb", "camera_ego_rgb"
STAND_IN = (8, 8, 3)
"""Shape of a black picture where a set has none, since FTP-1 refuses sets without any."""
RATE = 30
"""Frames per second where a set has only numbers of frames: most sets say so on their cards."""
OURS = {RAW: "tci_raw_", STAMPS: "tci_stamp_ns_", COUNT: "tci_count_"}
"""Arrays that only TCI writes and reads: raw skin at its own rate. Other readers ignore them."""


@dataclass(frozen=True, slots=True)
class _Group:
    """One patch as a group of touch."""

    patch: str
    side: str
    name: str
    area: int
    shape: tuple[int, ...]
    by_columns: bool

    def values(self, forces: NDArray[Any]) -> NDArray[Any]:
        if self.by_columns:
            rows, columns = self.shape
            return forces.reshape(-1, columns, rows).transpose(0, 2, 1)
        return forces.reshape(-1, *self.shape)


def write_oxt(data: DataSet, out: Path) -> tuple[str, ...]:
    """Writes the set as `out`/NAME.zarr, and says what this form has no place for.

    If an error occurs, nothing remains. Raises RecordingError if the folder exists or the disk fails.
    """
    with new_folder(out):
        return _Writer(data, out / f"{out.name}{SUFFIX}").write()


class _Writer:
    def __init__(self, data: DataSet, root: Path) -> None:
        self._data, self._root = data, root
        self._groups = [
            _group(patch, len(data.surfaces[patch.name].areas))
            for patch in data.robot.patches
            if patch.name in data.surfaces
        ]
        self._said = ["observation.contacts and action.wanted: the form has no place"]
        self._joints = self._choose_joints(data.features[STATE].names or ())

    def write(self) -> tuple[str, ...]:
        ends = np.cumsum([episode.frames for episode in self._data.episodes])
        make_group(self._root, {"tci": self._about()})
        make_group(self._root / "data")
        meta = make_group(self._root / "meta")
        put_array(meta / "episode_ends", ends.astype(np.int64))
        for patch, surface in self._data.surfaces.items():
            for what in ("positions", "normals", "areas"):
                put_array(meta / f"tci_{what}_{patch}", np.asarray(getattr(surface, what)))
        with ExitStack() as stack:
            arrays: dict[str, ArrayWriter] = {}
            for episode in self._data.episodes:
                begin = 0
                for block in self._data.blocks(episode):
                    for name, values in self._columns(block, episode.task, begin).items():
                        if name not in arrays:
                            shape = (int(ends[-1]), *values.shape[1:])
                            array = ArrayWriter(self._root / "data" / name, shape, values.dtype)
                            arrays[name] = stack.enter_context(array)
                        arrays[name].add(values)
                    begin += len(block[STATE])
        if any(len(episode.task) > WORDS for episode in self._data.episodes):
            self._said.append(f"sub_task_instruction: cut after {WORDS} characters")
        if self._data.pictures is None:
            self._said.append(f"{PICTURE}: a black stand-in of {STAND_IN[0]} x {STAND_IN[1]}, no picture")
        return (*self._data.left_out, *self._said)

    def _columns(self, block: Columns, task: str, begin: int) -> Columns:
        rows = len(block[STATE])
        found: Columns = {
            "timestamps": (begin + np.arange(rows)) / self._data.fps,
            "sub_task_instruction": np.full(rows, task[:WORDS], f"<U{WORDS}"),
        }
        if HEAD in block:
            found[HEAD_PICTURE] = block[HEAD].reshape(rows, *self._data.features[HEAD].shape)
        else:
            found[PICTURE] = np.zeros((rows, *STAND_IN), np.uint8)
        for name, places in self._joints.items():
            found[name] = block[STATE][:, places]
            found[f"{name}_action"] = block[ACTION][:, places]
        for side in SIDES:
            hand = f"{side}_hand_joints"
            slots = self._slots(side)
            if not slots:
                found[hand] = np.zeros((rows, 1), np.float32)
            found[f"{hand}_idx"] = np.tile(np.array(slots or [GRIPPER], np.int32), (rows, 1))
        sensor = f"TCI_{self._data.robot.name}"
        for group in self._groups:
            head, tail = f"{group.side}_tactile", group.name
            found[f"{head}_data_{tail}"] = group.values(block[f"{TACTILE}.{group.patch}"])[:, None]
            found[f"{head}_area_{tail}"] = np.full((rows, 1), group.area, np.int32)
            found[f"{head}_sensor_{tail}"] = np.full(rows, sensor)
            found[f"{head}_type_{tail}"] = np.full(
                rows, "matrix" if len(group.shape) == 2 else "state", "<U6"
            )
            for column, name in OURS.items():
                found[f"{name}{group.patch}"] = block[f"{column}.{group.patch}"]
        return found

    def _choose_joints(self, names: tuple[str, ...]) -> dict[str, list[int]]:
        """Places in the state of each array of joints."""
        parts: dict[str, list[int]] = {}
        for place, name in enumerate(names):
            parts.setdefault(name.partition(".")[0], []).append(place)
        found = {}
        for side in SIDES:
            arm = parts.pop(f"{side}_arm", []) + parts.pop(f"{side}_hand", [])
            if len(arm) > MOST["arm"]:
                self._said.append(f"{side} arm: joints after the first {MOST['arm']}")
            found[f"{side}_arm_joints"] = arm[: MOST["arm"]]
            found[f"{side}_hand_joints"] = parts.pop(f"{side}_fingers", [])
        rest: list[int] = []
        for part in ("torso", "left_leg", "right_leg", "head", *parts):
            places = parts.pop(part, [])
            if len(rest) + len(places) > MOST["supplementary"]:
                self._said.append(f"joints of {part}: the form has room for {MOST['supplementary']}")
            else:
                rest += places
        found["supplementary_joints"] = rest
        for side in SIDES:
            if not found[f"{side}_hand_joints"]:
                self._said.append(f"{side}_hand_joints: the robot has none, slot {GRIPPER} stands in as 0")
        return {name: places for name, places in found.items() if places}

    def _slots(self, side: str) -> list[int]:
        names = self._data.features[STATE].names or ()
        joints = [names[place].partition(".")[2] for place in self._joints.get(f"{side}_hand_joints", [])]
        return [SLOTS[joint] for joint in joints]

    def _about(self) -> dict[str, Any]:
        return {
            "robot": self._data.robot.name,
            "description_sha256": self._data.robot.digest,
            "fps": self._data.fps,
            "tactile_unit": "N on each taxel, the latest at each frame",
            "joints": {
                name: [(self._data.features[STATE].names or ())[place] for place in places]
                for name, places in self._joints.items()
            },
            "areas_proposed": AREAS,
            "groups": {f"{group.side}_tactile_data_{group.name}": group.patch for group in self._groups},
            "links": {patch: surface.link for patch, surface in self._data.surfaces.items()},
        }


def _group(patch: Patch, taxels: int) -> _Group:
    side = next((one for one in SIDES for name in (patch.part, patch.name) if name.startswith(one)), "")
    name = re.sub(r"[^a-z0-9_]", "_", patch.name.removeprefix(f"{side}_").lower())
    grid = patch.surface if isinstance(patch.surface, Grid) else None
    shape = (grid.rows, grid.columns) if grid else (taxels,)
    return _Group(
        patch=patch.name,
        side=side or "right",
        name=name if side else f"body_{name}",
        area=_area(patch),
        shape=shape,
        by_columns=grid is not None and grid.order == "column-major",
    )


def _area(patch: Patch) -> int:
    segment = PALM if patch.name.endswith(f"_{PALM}") else patch.segment
    if segment == PALM:
        return PALM_AREA
    if segment in TIPS:
        return (LOWER if patch.name.rpartition("_")[2] in BELOW_TIP else TIPS)[segment]
    where = patch.part.rpartition("_")[2]
    return AREAS["arm" if where in ("arm", "hand", "fingers") else "leg" if where == "leg" else "body"]


@dataclass(frozen=True, slots=True)
class OxtSet:
    """A set in the form of Open-X-Tactile, by any program."""

    folder: Path
    arrays: dict[str, ZarrArray]
    ends: tuple[int, ...]
    """Row after the last of each episode."""
    ours: dict[str, Any]
    """What TCI says of its own sets; empty for those of others."""

    def rows(self, name: str, episode: int) -> NDArray[Any]:
        """Values of an array in an episode. Raises RecordingError if there is no such episode, or it is
        damaged."""
        if not 0 <= episode < len(self.ends):
            raise RecordingError(f"{self.folder}: episode {episode}; valid: 0 to {len(self.ends) - 1}")
        return self.arrays[name].rows(self.ends[episode - 1] if episode else 0, self.ends[episode])


def is_oxt(path: Path) -> bool:
    return (path / "meta" / "episode_ends").is_dir() or any(path.glob(f"*{SUFFIX}/meta/episode_ends"))


def read_oxt(path: Path) -> OxtSet:
    """Reads what a set contains, without its values.

    `path` is a store or a folder with one. Raises RecordingError if it is none of this form.
    """
    stores = [path] if (path / "meta" / "episode_ends").is_dir() else sorted(path.glob(f"*{SUFFIX}"))
    if len(stores) != 1:
        names = ", ".join(store.name for store in stores[:5]) or f"no NAME{SUFFIX}"
        raise RecordingError(f"{path} has {names}; valid: one store of Open-X-Tactile")
    [folder] = stores
    ends = ZarrArray.open(folder / "meta" / "episode_ends")
    found = ends.rows(0, ends.shape[0])
    arrays = {
        one.parent.name: ZarrArray.open(one.parent) for one in sorted((folder / "data").glob("*/.zarray"))
    }
    lengths = {array.shape[0] for array in arrays.values()}
    growing = found.ndim == 1 and found.dtype.kind in "iu" and np.all(np.diff(found, prepend=0) > 0)
    if not len(found) or not growing or lengths != {int(found[-1])}:
        raise RecordingError(
            f"{folder}: episodes end at {found[-3:].tolist()}, arrays have {sorted(lengths)} rows; valid: "
            "ends that grow up to the number of rows of each array"
        )
    try:
        ours = json.loads((folder / ".zattrs").read_text(encoding="utf-8")).get("tci", {})
    except (OSError, ValueError, AttributeError):
        ours = {}
    return OxtSet(folder, arrays, tuple(found.tolist()), ours if isinstance(ours, dict) else {})


def import_oxt(path: Path, out: Path, episode: int, *, robot: Robot | None) -> Imported:
    """Writes the touch of an episode as a recording: raw skin, bit for bit, of sets that TCI wrote; of others
    a patch for each area of each group.

    Raises RecordingError if the set has no touch or it does not fit the robot.
    """
    data = read_oxt(path)
    raw = OURS[RAW]
    patches = [name.removeprefix(raw) for name in data.arrays if name.startswith(raw)]
    source = f"{data.folder.name}, episode {episode}"
    if patches:
        used = {f"{name}{patch}": f"{column}.{patch}" for column, name in OURS.items() for patch in patches}
        columns = {column: data.rows(name, episode) for name, column in used.items() if name in data.arrays}
        columns |= {name: values[:, None] for name, values in columns.items() if values.ndim == 1}
        frames = import_frames(skin_frames(columns), out, robot, middleware=FROM_FILE, source=source)
        return Imported(frames, left_out=tuple(name for name in data.arrays if name not in used))
    streams = Streams()
    touch, used_names, left_out = _touch(data, episode, streams)
    times, said = _times(data, episode)
    items = (
        tuple(
            SkinFrame(patch, float(time), number, values[number]) for patch, values in touch.items()
        )
        for number, time in enumerate(times)
    )  # fmt: skip
    frames = import_frames(items, out, robot, middleware=FROM_FILE, source=source)
    rest = [name for name in data.arrays if name not in used_names and name not in left_out]
    left = [*(f"{name}: {why}" for name, why in left_out.items()), *rest]
    return Imported(frames, (*said, *streams.doubts()), tuple(left))


def _touch(
    data: OxtSet, episode: int, streams: Streams
) -> tuple[dict[str, NDArray[Any]], set[str], dict[str, str]]:
    """Values (frames, n) of each patch, the arrays that were used, and why others were not."""
    found: dict[str, NDArray[Any]] = {}
    used, left_out = {"timestamps"}, dict[str, str]()
    for name in data.arrays:
        match = re.fullmatch(r"(left|right)_tactile_data_([a-z0-9_]+)", name)
        if match is None:
            continue
        side, group = match.groups()
        values = data.rows(name, episode)
        kind = f"{side}_tactile_type_{group}"
        said = str(data.rows(kind, episode)[0]) if kind in data.arrays else "state"
        if said == "image" or values.ndim < 3:
            first = values.ndim == 5 and values.shape[2] in (1, 3) and values.shape[4] > 4
            order = ", channels first" if first else ""
            left_out[name] = f"pictures {values.shape[1:]}{order}, no taxels" if said == "image" else (
                f"shape {values.shape}; valid: (frames, areas, values)"
            )  # fmt: skip
            continue
        areas = f"{side}_tactile_area_{group}"
        codes = data.rows(areas, episode)[0].ravel().tolist() if areas in data.arrays else []
        used |= {name, kind, areas, f"{side}_tactile_sensor_{group}"}
        for number in range(values.shape[1]):
            code = codes[number] if number < len(codes) else number
            patch = f"{side}_{group}" if values.shape[1] == 1 else f"{side}_{group}_{code}"
            if patch in found:
                patch = f"{patch}_{number}"
            found[patch] = streams.see(patch, values[:, number].reshape(len(values), -1))
    found = {patch: values for patch, values in found.items() if values.shape[1]}
    if not found:
        raise RecordingError(f"{data.folder} has no SIDE_tactile_data_GROUP with taxels; nothing to import")
    return found, used, left_out


def _times(data: OxtSet, episode: int) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Times [s] of the frames. Many sets have only their numbers."""
    rows = data.ends[episode] - (data.ends[episode - 1] if episode else 0)
    if "timestamps" in data.arrays:
        times = data.rows("timestamps", episode).ravel()
        if times.dtype.kind == "f" and np.all(np.isfinite(times)) and np.all(np.diff(times) > 0):
            return times.astype(np.float64), ()
        why = "are numbers of frames" if times.dtype.kind in "iu" else "do not grow"
        return np.arange(rows) / RATE, (f"timestamps {why}: {RATE} frames per second are assumed",)
    return np.arange(rows) / RATE, (f"no timestamps: {RATE} frames per second are assumed",)
