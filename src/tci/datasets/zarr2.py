"""Arrays of Zarr's format 2 (https://zarr.readthedocs.io) whose first axis is time.

They are written with NumPy and zstandard, and read with numcodecs where another program packed them (extra
`oxt`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import zstandard
from numpy.typing import NDArray

from tci.errors import RecordingError
from tci.support.installed import needs

CHUNK = 2 * 2**20
"""Size [bytes] of a chunk before compression, as Open-X-Tactile's own."""
LARGEST = 2**30
"""Size [bytes] of the largest chunk that is read, so that a hostile file takes no more memory."""
LEVEL = 3


def make_group(folder: Path, attributes: dict[str, Any] | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".zgroup").write_text(json.dumps({"zarr_format": 2}), encoding="utf-8")
    if attributes:
        (folder / ".zattrs").write_text(json.dumps(attributes), encoding="utf-8")
    return folder


def put_array(folder: Path, values: NDArray[Any]) -> None:
    """Writes a whole array."""
    with ArrayWriter(folder, values.shape, values.dtype) as writer:
        writer.add(values)


class ArrayWriter:
    """Writes one array of a known shape, block by block along its first axis."""

    def __init__(self, folder: Path, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        folder.mkdir(parents=True)
        self._folder, self._shape = folder, shape
        self._dtype = dtype.newbyteorder("<") if dtype.itemsize > 1 else dtype
        row = max(1, self._dtype.itemsize * math.prod(shape[1:]))
        self._rows = max(1, min(shape[0], CHUNK // row))
        self._chunk = self._empty()
        self._filled, self._number = 0, 0
        self._pack = zstandard.ZstdCompressor(level=LEVEL)
        about = {
            "zarr_format": 2,
            "shape": list(shape),
            "chunks": [self._rows, *shape[1:]],
            "dtype": self._dtype.str,
            "order": "C",
            "compressor": {"id": "zstd", "level": LEVEL},
            "fill_value": "" if self._dtype.kind == "U" else 0,
            "filters": None,
        }
        (folder / ".zarray").write_text(json.dumps(about), encoding="utf-8")

    def add(self, values: NDArray[Any]) -> None:
        """Appends rows; more than `shape` says raises ValueError."""
        if self._number * self._rows + self._filled + len(values) > self._shape[0]:
            raise ValueError(f"{self._folder.name}: more than {self._shape[0]} rows")
        while len(values):
            some = values[: self._rows - self._filled]
            self._chunk[self._filled : self._filled + len(some)] = some.reshape(len(some), *self._shape[1:])
            self._filled += len(some)
            values = values[len(some) :]
            if self._filled == self._rows:
                self._flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._filled and kind is None:
            self._flush()

    def _flush(self) -> None:
        name = ".".join([str(self._number)] + ["0"] * (len(self._shape) - 1))
        (self._folder / name).write_bytes(self._pack.compress(self._chunk.tobytes()))
        self._chunk, self._filled, self._number = self._empty(), 0, self._number + 1

    def _empty(self) -> NDArray[Any]:
        return np.zeros((self._rows, *self._shape[1:]), self._dtype)


@dataclass(frozen=True, slots=True)
class ZarrArray:
    """An array on disk."""

    folder: Path
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]
    compressor: dict[str, Any] | None
    filters: tuple[dict[str, Any], ...]
    fill: Any
    order: str
    separator: str

    @classmethod
    def open(cls, folder: Path) -> ZarrArray:
        """Reads what the array is. Raises RecordingError if it is none of format 2."""
        try:
            about = json.loads((folder / ".zarray").read_text(encoding="utf-8"))
            if about["zarr_format"] != 2:
                raise ValueError(f"format {about['zarr_format']}")
            found = cls(
                folder=folder,
                shape=tuple(map(int, about["shape"])),
                chunks=tuple(map(int, about["chunks"])),
                dtype=np.dtype(about["dtype"]),
                compressor=about["compressor"],
                filters=tuple(about["filters"] or ()),
                fill=about["fill_value"],
                order=about["order"],
                separator=about.get("dimension_separator", "."),
            )
            valid = len(found.shape) == len(found.chunks) >= 1 and min(found.chunks) > 0 <= min(found.shape)
            if not valid or found.dtype.hasobject or found.order not in "CF" or found.separator not in "./":
                raise ValueError("shape, type or order")
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise RecordingError(f"{folder} is no array of Zarr 2: {error}") from error
        size = math.prod(found.chunks) * found.dtype.itemsize
        if size > LARGEST:
            raise RecordingError(f"{folder}: chunks of {size} bytes; valid: at most {LARGEST}")
        return found

    def rows(self, begin: int, end: int) -> NDArray[Any]:
        """Returns the rows from `begin` to `end`. Raises RecordingError if they are damaged."""
        size = (end - begin) * math.prod(self.shape[1:]) * self.dtype.itemsize
        if size > LARGEST:
            raise RecordingError(f"{self.folder}: {size} bytes in one episode; valid: at most {LARGEST}")
        out = np.empty((end - begin, *self.shape[1:]), self.dtype)
        steps = self.chunks
        for place in _grid(self.shape, steps, begin, end):
            chunk = self._chunk(place)
            first = [k * step for k, step in zip(place, steps, strict=True)]
            lower = [max(first[0], begin), *first[1:]]
            upper = [
                min(f + step, size)
                for f, step, size in zip(first, steps, (end, *self.shape[1:]), strict=True)
            ]
            inner = tuple(slice(a - f, b - f) for a, b, f in zip(lower, upper, first, strict=True))
            outer = (slice(lower[0] - begin, upper[0] - begin), *map(slice, lower[1:], upper[1:]))
            out[outer] = chunk[inner]
        return out

    def _chunk(self, place: tuple[int, ...]) -> NDArray[Any]:
        path = self.folder / self.separator.join(map(str, place))
        try:
            data: Any = path.read_bytes()
        except FileNotFoundError:
            return np.full(self.chunks, 0 if self.fill is None else self.fill, self.dtype)
        except OSError as error:
            raise RecordingError(f"{path} can't be read: {error.strerror}") from error
        size = math.prod(self.chunks) * self.dtype.itemsize
        try:
            data = self._unpack(data, size)
            return np.frombuffer(data, self.dtype).reshape(self.chunks, order=self.order)  # type: ignore[call-overload, no-any-return]
        except (ValueError, RuntimeError, TypeError, zstandard.ZstdError) as error:
            raise RecordingError(f"{path} is damaged: {error}") from error

    def _unpack(self, data: Any, size: int) -> Any:
        """The bytes of a chunk of `size` bytes. Other codecs don't say beforehand how much they unpack to."""
        codec = None if self.compressor is None else self.compressor.get("id")
        if self.filters or codec not in (None, "zstd", "blosc"):
            used = ", ".join(str(one.get("id")) for one in (*self.filters, *filter(None, [self.compressor])))
            raise RecordingError(
                f"{self.folder} is packed by {used}; valid: zstd, blosc or nothing, no filter"
            )
        if self.compressor is None:
            return data
        if codec == "zstd":
            if zstandard.frame_content_size(data) > size:
                raise ValueError(f"more than {size} bytes")
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        with needs(f"reading {self.folder}, packed by another program", "oxt"):
            import numcodecs

        if _blosc_size(data) > size:
            raise ValueError(f"more than {size} bytes")
        return numcodecs.get_codec(dict(self.compressor)).decode(data)


def _blosc_size(data: bytes) -> int:
    """Size that a Blosc buffer says it unpacks to."""
    return int.from_bytes(data[4:8], "little")


def _grid(shape: tuple[int, ...], steps: tuple[int, ...], begin: int, end: int) -> Iterator[tuple[int, ...]]:
    if end <= begin or 0 in shape:
        return
    counts = [-(-size // step) for size, step in zip(shape, steps, strict=True)]
    first = begin // steps[0]
    for k in np.ndindex((end - 1) // steps[0] - first + 1, *counts[1:]):
        yield (k[0] + first, *k[1:])
