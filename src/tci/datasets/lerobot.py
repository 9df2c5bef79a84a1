"""Writes and reads data sets of LeRobot, format v3.0 (https://github.com/huggingface/lerobot), with PyArrow
and without LeRobot (extra `parquet`).

Every name that LeRobot fixes is in this file, so a change of the format is a change here.
"""

from __future__ import annotations

import io
import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tci.datasets.episodes import COUNT, IMAGE, RAW, STAMPS, Columns, DataSet, Feature
from tci.datasets.new_folder import new_folder
from tci.datasets.raw_skin import skin_frames
from tci.datasets.statistics import Statistics
from tci.errors import RecordingError
from tci.messages import SkinFrame
from tci.recording.importing import FROM_FILE, Imported, import_frames
from tci.robot.description import Robot
from tci.support.installed import needs

with needs("data sets of LeRobot", "parquet"):
    import pyarrow as pa
    from pyarrow import parquet

VERSION = "v3.0"
STRIDE = 8
"""Every eighth pixel of every eighth line counts for statistics, as LeRobot thins pictures out too."""
LARGEST = 100
"""Size [MB] after which the next episode begins a new file, as LeRobot's own default."""
PER_CHUNK = 1000
"""Files in a folder, as LeRobot's own default."""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEOS = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
INFO, STATS, TASKS, LAYOUT = "meta/info.json", "meta/stats.json", "meta/tasks.parquet", "meta/tci"
OWN = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Columns that LeRobot itself needs."""
PLACE = (
    "episode_index",
    "tasks",
    "data/chunk_index",
    "data/file_index",
    "dataset_from_index",
    "dataset_to_index",
)
"""Columns of an episode's row that are read. The others are statistics, hundreds of times as large."""


def write_lerobot(data: DataSet, out: Path, *, licence: str = "other", columns: Collection[str] = ()) -> None:
    """Writes the set to a new folder.

    `licence` is named on the set's card. Of `columns` only these are written; none: all, which LeRobot's
    loader takes dozens of milliseconds to read for each row, used or not. If an error occurs, nothing
    remains. Raises RecordingError for an unknown column, if the folder exists or the disk fails.
    """
    if unknown := [name for name in columns if name not in data.features]:
        raise RecordingError(f"columns {', '.join(unknown)}; valid: {', '.join(data.features)}")
    with new_folder(out):
        _Writer(data, out, columns or data.features).write(licence)


class _Writer:
    def __init__(self, data: DataSet, out: Path, names: Collection[str]) -> None:
        self._data, self._out = data, out
        self._features = {name: one for name, one in data.features.items() if name in names} | {
            name: Feature(dtype, 1) for name, dtype in OWN.items()
        }
        self._schema = pa.schema([(name, _type(one)) for name, one in self._features.items()])
        self._tasks = list(dict.fromkeys(episode.task for episode in data.episodes))
        self._file: parquet.ParquetWriter | None = None
        self._number = -1
        self._total = {name: Statistics() for name in self._features}
        self._index = 0

    def write(self, licence: str) -> None:
        rows = [self._episode(number) for number in range(len(self._data.episodes))]
        if self._file is not None:
            self._file.close()
        parquet.write_table(_table(rows), _made(self._out / _at(EPISODES, 0)))
        stats = {
            name: {
                key: value.tolist() for key, value in _result(one, self._features[name], self._index).items()
            }
            for name, one in self._total.items()
        }
        (self._out / STATS).write_text(json.dumps(stats), encoding="utf-8")
        self._write_tasks()
        self._write_layout()
        (self._out / INFO).write_text(json.dumps(self._info(), indent=1), encoding="utf-8")
        (self._out / "README.md").write_text(self._card(licence), encoding="utf-8")

    def _episode(self, number: int) -> dict[str, Any]:
        episode, begin = self._data.episodes[number], self._index
        self._roll()
        assert self._file is not None
        stats = {name: Statistics() for name in self._features}
        for block in self._data.blocks(episode):
            columns = block | self._own(number, len(next(iter(block.values()))), begin)
            for name, one in stats.items():
                one.add(_counted(columns[name], self._features[name]))
            arrays = [_array(columns[name], one) for name, one in self._features.items()]
            self._file.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        for name, one in stats.items():
            self._total[name].merge(one)
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [episode.task],
            "length": self._index - begin,
            "data/chunk_index": self._number // PER_CHUNK,
            "data/file_index": self._number % PER_CHUNK,
            "dataset_from_index": begin,
            "dataset_to_index": self._index,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for name, one in stats.items():
            found = _result(one, self._features[name], self._index - begin)
            row |= {f"stats/{name}/{key}": value.tolist() for key, value in found.items()}
        return row

    def _own(self, episode: int, rows: int, begin: int) -> Columns:
        index = np.arange(self._index, self._index + rows)
        self._index += rows
        frame = index - begin
        columns = {
            "timestamp": frame / self._data.fps,
            "frame_index": frame,
            "episode_index": np.full(rows, episode),
            "index": index,
            "task_index": np.full(rows, self._tasks.index(self._data.episodes[episode].task)),
        }
        return {name: values.astype(OWN[name])[:, None] for name, values in columns.items()}

    def _roll(self) -> None:
        path = self._out / _at(DATA, max(self._number, 0))
        if self._file is not None and path.stat().st_size < LARGEST * 10**6:
            return
        if self._file is not None:
            self._file.close()
        self._number += 1
        path = _made(self._out / _at(DATA, self._number))
        self._file = parquet.ParquetWriter(path, self._schema, compression="snappy")

    def _write_tasks(self) -> None:
        """The texts of the tasks are pandas' index of this table, as LeRobot reads it."""
        columns = [("task_index", "int64", "int64", "task_index"), ("task", "unicode", "object", "task")]
        words = {
            "index_columns": ["task"],
            "column_indexes": [],
            "columns": [
                {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": own, "metadata": None}
                for name, kind, own, field in columns
            ],
            "pandas_version": "2.2.0",
        }
        table = pa.table({"task_index": np.arange(len(self._tasks)), "task": self._tasks})
        table = table.replace_schema_metadata({b"pandas": json.dumps(words).encode()})
        parquet.write_table(table, self._out / TASKS)

    def _write_layout(self) -> None:
        """Where the taxels are, for which LeRobot has no place."""
        for patch, surface in self._data.surfaces.items():
            table = pa.table(
                {
                    "position_m": _array(surface.positions, Feature("float64", 3)),
                    "normal": _array(surface.normals, Feature("float64", 3)),
                    "area_m2": surface.areas,
                    "channel": surface.channels,
                }
            ).replace_schema_metadata({b"link": surface.link.encode()})
            parquet.write_table(table, _made(self._out / LAYOUT / f"{patch}.parquet"))

    def _info(self) -> dict[str, Any]:
        data = self._data
        return {
            "codebase_version": VERSION,
            "robot_type": f"tci_{data.robot.name}",
            "total_episodes": len(data.episodes),
            "total_frames": self._index,
            "total_tasks": len(self._tasks),
            "chunks_size": PER_CHUNK,
            "data_files_size_in_mb": LARGEST,
            "video_files_size_in_mb": 200,
            "fps": data.fps,
            "splits": {"train": f"0:{len(data.episodes)}"},
            "data_path": DATA,
            "video_path": None,
            "features": {
                name: {
                    "dtype": one.dtype,
                    "shape": [*one.shape] or [one.size],
                    "names": None if one.names is None else list(one.names),
                    **({"info": one.info} if one.info else {}),
                }
                for name, one in self._features.items()
            },
        }

    def _card(self, licence: str) -> str:
        tasks = "\n".join(f"- {task}" for task in self._tasks)
        return f"""---
license: {licence}
task_categories:
- robotics
tags:
- LeRobot
- tactile
- touch
- {self._data.robot.name}
configs:
- config_name: default
  data_files: data/*/*.parquet
---
# Touch on {self._data.robot.name}

{len(self._data.episodes)} episodes, {self._index} frames at {self._data.fps} frames per second, written by
TCI. `action` holds the angles that were sent to the robot. `{RAW}.PATCH` holds every raw
skin frame since the row before, one after the other; `{COUNT}.PATCH` says how many there
are, `{STAMPS}.PATCH` when each was measured. Positions, normals and areas of the taxels
are in `{LAYOUT}`.

Tasks:
{tasks}
"""


@dataclass(frozen=True, slots=True)
class LeRobotSet:
    """A data set of LeRobot, by any program. Pictures and videos are left out."""

    folder: Path
    fps: float
    robot_type: str
    features: dict[str, Feature]
    tasks: tuple[str, ...]
    """Task of each episode."""
    left_out: tuple[str, ...]
    """Features that are not read, each with the reason."""
    places: tuple[tuple[Path, int, int], ...]
    """File of each episode, and its first row and the row after its last within the set."""

    def episode(self, number: int) -> Columns:
        """Returns the columns (frames, size) of an episode, in their own types.

        Raises RecordingError if the set has no such episode or its file is damaged.
        """
        if not 0 <= number < len(self.places):
            raise RecordingError(f"{self.folder}: episode {number}; valid: 0 to {len(self.places) - 1}")
        path, begin, end = self.places[number]
        names = [*self.features]
        try:
            table = parquet.read_table(
                path, columns=names, filters=[("index", ">=", begin), ("index", "<", end)]
            )
        except (OSError, pa.ArrowException, KeyError) as error:
            raise RecordingError(f"{path} can't be read: {error}") from error
        if len(table) != end - begin:
            raise RecordingError(f"{path} has {len(table)} rows of episode {number}; valid: {end - begin}")
        return {name: _rows(table[name], self.features[name]) for name in names}

    def frames(self, number: int) -> Iterator[tuple[SkinFrame, ...]]:
        """Yields the raw skin frames of an episode as TCI wrote them, in the order of their times.

        Raises RecordingError if the set has none.
        """
        columns = self.episode(number)
        if not any(name.startswith(f"{RAW}.") for name in columns):
            raise RecordingError(
                f"{self.folder} has no {RAW}.PATCH, so no raw skin frames; valid: a set that tci log export "
                "wrote without --columns"
            )
        yield from skin_frames(columns)


def import_lerobot(folder: Path, out: Path, episode: int, *, robot: Robot | None) -> Imported:
    """Writes the raw skin frames of an episode as a recording.

    Raises RecordingError if the set has none or they do not fit the robot.
    """
    data = read_lerobot(folder)
    used = (RAW, STAMPS, COUNT)
    left_out = [name for name in data.features if not name.startswith(used) and name not in OWN]
    source = f"{folder.name}, episode {episode}"
    frames = import_frames(data.frames(episode), out, robot, middleware=FROM_FILE, source=source)
    return Imported(frames, left_out=(*left_out, *data.left_out))


def read_lerobot(folder: Path) -> LeRobotSet:
    """Reads what a set contains, without its values. Raises RecordingError if it is none of format v3."""
    try:
        info = json.loads((folder / INFO).read_text(encoding="utf-8"))
        version = info["codebase_version"]
        if not str(version).startswith("v3"):
            raise RecordingError(f"{folder} is of LeRobot's format {version}; valid: {VERSION}")
        tables = [
            parquet.read_table(path, columns=list(PLACE)).to_pylist()
            for path in sorted(folder.glob("meta/episodes/*/*.parquet"))
        ]
        rows = sorted((row for table in tables for row in table), key=lambda row: row["episode_index"])
        features, left_out = {}, []
        for name, one in info["features"].items():
            shape = [int(size) for size in one["shape"]]
            if one["dtype"] in ("video", "image", "string"):
                left_out.append(f"{name}: {one['dtype']} is not read")
            else:
                size = int(np.prod(shape))
                features[name] = Feature(
                    one["dtype"], size, _names(one.get("names"), size), one.get("info") or {}
                )
        places = tuple(
            (
                folder / info["data_path"].format(
                    chunk_index=row["data/chunk_index"], file_index=row["data/file_index"]
                ),
                row["dataset_from_index"],
                row["dataset_to_index"],
            )
            for row in rows
        )  # fmt: skip
        return LeRobotSet(
            folder=folder, fps=float(info["fps"]), robot_type=str(info.get("robot_type") or ""),
            features=features, tasks=tuple(", ".join(row["tasks"]) for row in rows),
            left_out=tuple(left_out), places=places,
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException) as error:
        raise RecordingError(f"{folder} is no data set of LeRobot {VERSION}: {error!r}") from error


def _names(found: Any, size: int) -> tuple[str, ...] | None:
    """Names of the values. Many sets have them in groups ({"motors": [...]}); those of a matrix name its axes
    instead, and are dropped."""
    groups = list(found.values()) if isinstance(found, dict) else [found]
    if not all(isinstance(group, list) for group in groups):
        return None
    flat = tuple(name for group in groups for name in group)
    return flat if len(flat) == size else None


def _at(pattern: str, number: int) -> str:
    return pattern.format(chunk_index=number // PER_CHUNK, file_index=number % PER_CHUNK)


def _made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _counted(values: NDArray[Any], feature: Feature) -> NDArray[Any]:
    """What statistics are made of: of pictures the colours, 0 to 1, of every eighth pixel of a row."""
    if feature.dtype != IMAGE:
        return values
    return values.reshape(-1, *feature.shape)[:, ::STRIDE, ::STRIDE].reshape(-1, 3) / 255.0


def _result(stats: Statistics, feature: Feature, frames: int) -> dict[str, NDArray[Any]]:
    """Statistics in LeRobot's form: those of a colour of pictures have the shape (3, 1, 1)."""
    found = stats.result()
    if feature.dtype != IMAGE:
        return found
    return {name: value.reshape(3, 1, 1) for name, value in found.items() if name != "count"} | {
        "count": np.array([frames])
    }


def _png(values: NDArray[Any], feature: Feature) -> bytes:
    file = io.BytesIO()
    Image.fromarray(values.reshape(feature.shape)).save(file, "png")
    return file.getvalue()


def _type(feature: Feature) -> pa.DataType:
    if feature.dtype == IMAGE:
        return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    own = pa.from_numpy_dtype(np.dtype(feature.dtype))
    return own if feature.size == 1 else pa.list_(own, feature.size)


def _array(values: NDArray[Any], feature: Feature) -> pa.Array:
    if feature.dtype == IMAGE:
        return pa.array([{"bytes": _png(one, feature), "path": None} for one in values], _type(feature))
    flat = pa.array(np.ascontiguousarray(values).ravel())
    return flat if feature.size == 1 else pa.FixedSizeListArray.from_arrays(flat, feature.size)


def _rows(column: pa.ChunkedArray, feature: Feature) -> NDArray[Any]:
    """Also flattens matrices, which LeRobot stores as lists of lists."""
    array = column.combine_chunks()
    rows = len(array)
    while pa.types.is_list(array.type) or pa.types.is_fixed_size_list(array.type):
        array = array.flatten()
    values: NDArray[Any] = array.to_numpy(zero_copy_only=False)
    return values.reshape(rows, feature.size)


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    return pa.Table.from_pylist(rows)
