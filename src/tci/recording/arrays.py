"""Imports frames of taxels from arrays of other programs (NPZ, MATLAB files, CSV).

A mapping file (TOML) contains the name of the array of times and, for each patch, the name of the array of
values:

    time = "t"                  # array or column of times; or rate = 100.0 [Hz]
    seconds = 0.001             # length [s] of the unit of the times; default 1

    [skin.left_forearm]
    values = "pressure"         # array (frames, ...); or first and last column of a CSV file, "p0:p191"
    axis = 0                    # axis of the frames; -1 for the last axis, as often in MATLAB files
    channels = [0, 1, 2, 5]     # channel of each value; default: all in order
"""

from __future__ import annotations

import csv
import math
import re
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from tci.errors import DescriptionError, Fault, RecordingError
from tci.messages import SkinFrame
from tci.messages.frames import Array, read_only
from tci.recording.doubts import Streams
from tci.recording.importing import FROM_FILE, LONGEST_LINE, Imported, import_frames
from tci.robot.description import Description, Patch, Robot
from tci.robot.xml.values import NUMBER

SUFFIXES = (".npz", ".mat", ".csv")
LARGEST = 2**30
"""Largest size [bytes] of an array in memory. Assumed: this is enough for 45 minutes of 500 taxels at 100 Hz.
"""
LARGEST_MAPPING = 2**20
"""Largest size [bytes] of a mapping file (TOML) that is read. Assumed: enough for 60 patches with lists of
4000 channels."""
_CELL = re.compile(rf"[ \t]*(?:{NUMBER}|[nN]a[nN])[ \t]*")
"""Pattern of a cell of a CSV file: NaN (a missing number), or a number in the syntax that robot descriptions
permit."""

Numbers = NDArray[np.number[Any]]


class PatchValues(Description):
    """Values of one patch."""

    values: str
    """Name of the array that contains the values of all frames. In a CSV file: names of its first and last
    column, FIRST:LAST."""
    axis: int = 0
    """Axis of the array along which the frames follow each other. The other axes are flattened; the last of
    them varies fastest."""
    channels: tuple[int, ...] | None = Field(default=None, strict=False)
    """Channel of each value. None if `values` has a value for every channel, in order. A channel without a
    value gets the rest value of the robot's patch, or 0 if there is no robot."""

    @model_validator(mode="after")
    def _once(self) -> PatchValues:
        listed = self.channels or ()
        if len(set(listed)) < len(listed) or min(listed, default=0) < 0 or max(listed, default=0) >= 10**6:
            raise ValueError("channels: valid: numbers of 0 to 999999, each once")
        return self


class Mapping(Description):
    """Contents of a mapping file: where a file of arrays contains the times and the values."""

    time: str | None = None
    """Name of the array or column with the times (frames,)."""
    rate: float | None = Field(default=None, gt=0.0)
    """Rate [Hz] of the frames. The mapping needs this value if the file has no times."""
    seconds: float = Field(default=1.0, gt=0.0)
    """Length [s] of the unit in which the times are given."""
    skin: dict[str, PatchValues] = Field(min_length=1)
    """Values of each patch, by the patch's name."""

    @model_validator(mode="after")
    def _timed(self) -> Mapping:
        if (self.time is None) == (self.rate is None):
            raise ValueError("valid: either time or rate")
        named = [one.values for one in self.skin.values()] + [self.time]
        if double := next((name for name in named if named.count(name) > 1), None):
            raise ValueError(f"{double!r} is named twice; valid: each once")
        return self


def read_mapping(path: Path) -> Mapping:
    """Reads a mapping. Raises DescriptionError that lists every fault of the file."""
    try:
        if path.stat().st_size > LARGEST_MAPPING:
            raise DescriptionError(str(path), [Fault(0, f"larger than {LARGEST_MAPPING} bytes")])
        return Mapping.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        faults = [f"can't be read: {error.strerror}"]
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        faults = [f"is not TOML in UTF-8: {error}"]
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, one['loc'])) or 'mapping'}: {one['msg']}" for one in error.errors()]
    raise DescriptionError(str(path), [Fault(0, fault) for fault in faults])


def import_arrays(file: Path, out: Path, mapping: Path, *, robot: Robot | None = None) -> Imported:
    """Converts a file of arrays to a recording.

    If `robot` is given, the patches are patches of this robot, and in the recording its joints rest at the
    initial posture. Raises DescriptionError if the mapping has faults. Raises RecordingError if the file does
    not fit the mapping.
    """
    names = read_mapping(mapping)
    patches = {} if robot is None else {name: robot.patch(name) for name in names.skin}
    rows = _csv_rows if file.suffix.lower() == ".csv" else _array_rows
    streams, source = Streams(chosen=True), f"arrays of {file.name}"
    try:
        frames = streams.watch(_frames(rows(file, names), names, patches))
        periods = import_frames(frames, out, robot, middleware=FROM_FILE, source=source)
        return Imported(periods, streams.doubts(), _left_out(file, names))
    except OSError as error:
        raise RecordingError(f"{file} can't be read: {error.strerror or error}") from error


def _left_out(file: Path, names: Mapping) -> tuple[str, ...]:
    """Arrays or columns of the file that the mapping does not name."""
    words = [one.values for one in names.skin.values()] + ([names.time] if names.time else [])
    if file.suffix.lower() != ".csv":
        there = _sizes(file)
        return tuple(name for name in there if name not in words)
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        _, head = _head(_bounded(lines, file))
    used = {head[k] for word in words for k in range(len(head))[_columns(file, head, word)]}
    return tuple(name for name in head if name not in used)


def _frames(
    rows: Iterator[tuple[float, list[Numbers]]], names: Mapping, patches: dict[str, Patch]
) -> Iterator[tuple[SkinFrame, ...]]:
    bases = {name: _base(one, patches.get(name)) for name, one in names.skin.items()}
    for number, (time, values) in enumerate(rows):
        stamp = time * names.seconds if names.rate is None else number / names.rate
        if not np.isfinite(stamp):
            raise RecordingError(f"frame {number}: the time {time}; valid: finite")
        item = []
        for (name, one), raw in zip(names.skin.items(), values, strict=True):
            base = bases[name]
            if one.channels is not None and base is not None:
                if len(raw) != len(one.channels):
                    raise RecordingError(
                        f"{name}: {len(raw)} values in a frame; valid: {len(one.channels)}, one for each "
                        "of its channels"
                    )
                frame = base.astype(np.result_type(base, raw))
                frame[list(one.channels)] = raw
                raw = frame
            item.append(SkinFrame(name, stamp, number, read_only(raw, raw.dtype)))
        yield tuple(item)


def _base(one: PatchValues, patch: Patch | None) -> Numbers | None:
    """Returns the raw values (channels,) of a patch at rest, which stand for the channels to which the
    mapping file gives no values.

    Returns None if the mapping file lists no channels: the imported values then contain all channels, in
    order.
    """
    if one.channels is None:
        return None
    needed = max(one.channels, default=-1) + 1
    if patch is None:
        return np.zeros(needed, np.int8)
    if needed > patch.channels:
        raise RecordingError(
            f"skin.{patch.name}: channel {needed - 1}; valid: 0 to {patch.channels - 1} of {patch.name}"
        )
    return np.full(patch.channels, patch.sensor.rest, np.float32)


def _array_rows(file: Path, names: Mapping) -> Iterator[tuple[float, list[Numbers]]]:
    wanted = [one.values for one in names.skin.values()] + ([names.time] if names.time else [])
    arrays = (_npz if file.suffix.lower() == ".npz" else _mat)(file, wanted)
    blocks: list[Numbers] = []
    for name, one in names.skin.items():
        values = arrays[one.values]
        if not -values.ndim <= one.axis < values.ndim:
            raise RecordingError(
                f"{file}: {one.values} has the shape {values.shape}, skin.{name} the axis {one.axis}; "
                "valid: one of its axes"
            )
        values = np.moveaxis(values, one.axis, 0)
        blocks.append(values.reshape(len(values), math.prod(values.shape[1:])))
    times: Numbers = np.zeros(len(blocks[0])) if names.time is None else arrays[names.time].ravel()
    lengths = {len(times), *map(len, blocks)}
    if len(lengths) > 1:
        told = ", ".join(
            f"{one.values} {len(block)}" for one, block in zip(names.skin.values(), blocks, strict=True)
        )
        raise RecordingError(
            f"{file}: frames of {told}, times {len(times)}; valid: one number for all (see axis)"
        )
    for number, time in enumerate(times):
        yield float(time), [block[number] for block in blocks]


def _npz(file: Path, wanted: list[str]) -> dict[str, Numbers]:
    try:
        _permit(file, _sizes(file), wanted)
        with np.load(file, allow_pickle=False) as arrays:
            return {name: _numbers(file, name, arrays[name]) for name in wanted}
    except (
        ValueError, OSError, EOFError, MemoryError, zlib.error, zipfile.BadZipFile, NotImplementedError,
    ) as error:  # fmt: skip
        raise RecordingError(f"{file} is no NPZ file of numbers: {error}") from error


def _mat(file: Path, wanted: list[str]) -> dict[str, Numbers]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        _permit(file, _sizes(file), wanted)
        arrays = loadmat(file, variable_names=wanted)
        return {name: _numbers(file, name, arrays[name]) for name in wanted}
    except NotImplementedError:
        raise RecordingError(f"{file} is a MATLAB file of version 7.3; valid: saved with -v7") from None
    except (MatReadError, ValueError, TypeError, KeyError, OSError, MemoryError, zlib.error) as error:
        raise RecordingError(f"{file} is no MATLAB file that can be read: {error}") from error


def _sizes(file: Path) -> dict[str, int]:
    """Size [bytes] of each array in a file, at most."""
    if file.suffix.lower() == ".npz":
        with zipfile.ZipFile(file) as members:
            return {member.filename.removesuffix(".npy"): member.file_size for member in members.infolist()}
    from scipy.io import whosmat

    return {name: 16 * int(np.prod(shape, dtype=object)) for name, shape, _ in whosmat(file)}


def _permit(file: Path, sizes: dict[str, int], wanted: list[str]) -> None:
    for name in wanted:
        if name not in sizes:
            raise RecordingError(f"{file} has no array {name!r}; valid: {', '.join(sorted(sizes)[:20])}")
        if sizes[name] > LARGEST:
            raise RecordingError(f"{file}: {name} takes {sizes[name]} bytes; valid: up to {LARGEST}")


def _numbers(file: Path, name: str, array: Any) -> Numbers:
    found = np.asarray(array)
    if found.dtype.kind not in "iuf" or found.dtype.itemsize > 8 or found.ndim == 0:
        raise RecordingError(
            f"{file}: {name} is {found.dtype} {found.shape}; valid: an array of numbers of 8 bytes at most"
        )
    return found


def _csv_rows(file: Path, names: Mapping) -> Iterator[tuple[float, list[Numbers]]]:
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        text = _bounded(lines, file)
        try:
            mark, head = _head(text)
            rows = csv.reader(
                text if mark == "," else (line.replace(",", ".") for line in text), delimiter=mark
            )
            if len(set(head)) < len(head):
                double = next(name for name in head if head.count(name) > 1)
                raise RecordingError(f"{file} has two columns {double!r}; valid: each name once")
            blocks = [_columns(file, head, one.values) for one in names.skin.values()]
            time = None if names.time is None else _time(file, head, names.time)
            _check_columns(file, head, names, blocks, time)
            for number, row in enumerate(rows, start=2):
                if not any(map(str.strip, row)):
                    continue
                if len(row) != len(head):
                    raise RecordingError(
                        f"{file}, row {number}: {len(row)} cells; valid: {len(head)}, as in the header"
                    )
                read = [row[time]] if time is not None else []
                for cell in (*read, *(cell for block in blocks for cell in row[block])):
                    if not _CELL.fullmatch(cell):
                        raise RecordingError(f"{file}, row {number}: {cell[:20]!r}; valid: numbers")
                values: list[Array] = [np.array(row[block], dtype=np.float64) for block in blocks]
                yield float(read[0]) if read else 0.0, list(values)
        except csv.Error as error:
            raise RecordingError(
                f"{file}: {error}; valid: cells separated by commas, semicolons or tabs"
            ) from None


def _head(text: Iterator[str]) -> tuple[str, list[str]]:
    """What separates the columns of a file, and their names."""
    first = next(text, "")
    mark = "\t" if "\t" in first else ";" if ";" in first else ","
    return mark, [cell.strip() for cell in next(csv.reader([first], delimiter=mark), [])]


def _bounded(lines: IO[str], file: Path) -> Iterator[str]:
    while line := lines.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise RecordingError(f"{file}: a line longer than {LONGEST_LINE} characters")
        yield line


def _time(file: Path, head: list[str], name: str) -> int:
    found = _columns(file, head, name)
    if found.stop - found.start > 1:
        raise RecordingError(f"{file}: time = {name!r}; valid: one column")
    return int(found.start)


def _check_columns(
    file: Path, head: list[str], names: Mapping, blocks: list[slice], time: int | None
) -> None:
    """Raises RecordingError if one column of the file has two meanings. `blocks` are the columns of each
    patch, and `time` is the column of the times."""
    meaning = {} if time is None else {time: "time"}
    for patch, block in zip(names.skin, blocks, strict=True):
        for column in range(block.start, block.stop):
            if column in meaning:
                raise RecordingError(
                    f"{file}: {head[column]} is in the columns of {meaning[column]} and of skin.{patch}; "
                    "valid: one of them"
                )
            meaning[column] = f"skin.{patch}"


def _columns(file: Path, head: list[str], words: str) -> slice:
    """Returns the range of columns that `words` names: one column NAME, or several as FIRST:LAST. `head`
    contains the names of all columns of the file."""
    first, _, last = words.partition(":")
    try:
        begin, end = head.index(first), head.index(last or first)
    except ValueError:
        shown = ", ".join(head[:8])
        raise RecordingError(
            f"{file} has no columns {words!r}; valid: of {shown}, ... or FIRST:LAST"
        ) from None
    if end < begin:
        raise RecordingError(
            f"{file}: columns {words!r} end before they begin; valid: FIRST:LAST in this order"
        )
    return slice(begin, end + 1)
