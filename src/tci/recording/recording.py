"""Reads recordings from untrusted sources. A recording may be complete, cut off because a process was killed,
or damaged in some of its chunks: what lies before and after these is read, and what is lost is told.

Nothing in the file is trusted. Sizes are checked before memory is allocated, only the messages of `schemas`
are decoded, and nothing in the file is executed.
"""

from __future__ import annotations

import io
import logging
import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream

from tci.errors import RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import Array
from tci.recording.growing import OPEN
from tci.recording.rosmsg.cdr import MessageType, decode
from tci.recording.schemas import (
    CLOUD,
    COMMAND,
    COMMAND_1,
    DECISION,
    DECISION_1,
    FORMAT,
    IMU,
    JOINTS,
    SKIN,
    TICK,
    TRUTH,
    to_frame,
    to_gravity,
    to_joints,
)

_log = logging.getLogger("tci")
VALID = "valid: a recording of TCI (.mcap), as from tci record or tci run --record"
"""End of each error message about a file that is not a whole recording."""
LARGEST = OPEN
"""Largest size [bytes] of a record, and of a chunk after decompression. Assumed: records and chunks of TCI's
own recordings are smaller than 2 MiB."""
PIECE = 2**10
"""Bytes that are unpacked together where a chunk did not end: what a damaged piece holds is lost."""
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_PERIODS = (1e-4, 10.0)
"""Shortest and longest control period [s] that is accepted in a recording. Assumed: no control loop has a
period outside this range.
"""
_FORMATS = {"1": (COMMAND_1, DECISION_1), "2": (COMMAND_1, DECISION), str(FORMAT): (COMMAND, DECISION)}
"""Message types of commands and decisions for each recording format that can be read."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTick:
    """One recorded period of the loop."""

    now: float
    """Time [s] on the driver's clock."""
    reading: Reading
    """Reading of the robot."""
    commands: tuple[dict[str, Any], ...]
    """Commands of the capability. Each command has the fields of `schemas.COMMAND`."""
    decision: dict[str, Any] | None
    """Command that the gate passed and the driver sent, with the fields of the message `schemas.DECISION`.
    The value is None if nothing was sent.
    """


@dataclass(frozen=True, slots=True)
class LostChunk:
    """A part of a recording that can't be unpacked."""

    begin: float
    """Time [s] of its first message, on the recording's clock."""
    end: float
    """Time [s] of its last message."""
    reason: str

    def __str__(self) -> str:
        return f"{self.begin:.3f} to {self.end:.3f} s can't be read: {self.reason}"


@dataclass(frozen=True, slots=True)
class Topic:
    """How much of one kind a recording has."""

    messages: int
    first: float
    """Time [s] of its earliest message, on the recording's clock."""
    last: float


@dataclass(slots=True)
class _State:
    """Latest joint data and skin frames before a position in the file, while the file is read."""

    joints: dict[str, Any] | None = None
    gravity: Array | None = None
    frames: dict[int, SkinFrame] = field(default_factory=dict)
    reading: JointReading | None = None

    def has(self, tick: dict[str, Any]) -> bool:
        """True if everything that a period needs was read since the last damaged part."""
        return self.joints is not None and self.frames.keys() >= {*tick["skin"].tolist()}


class Recording:
    """A recording on disk. The methods read the file in small pieces, so the whole file is never in
    memory."""

    def __init__(self, path: Path | str) -> None:
        """Raises RecordingError if the file is not a recording.

        Raises FileNotFoundError and other OSError if the file can't be opened.
        """
        self.path = Path(path)
        self._told: set[LostChunk] = set()
        self.about: dict[str, str] = {}
        """Metadata, for example robot, description_sha256, middleware, period_s, begun, versions and
        capability."""
        self.complete = False
        """True if the recording was completed (`Recorder.close`). The value is valid only after the file has
        been read to its end."""
        self.lost: tuple[LostChunk, ...] = ()
        """Damaged parts, as far as the file has been read. Periods that need data of such a part are left
        out. Each part is also logged, once."""
        for record in self._records():
            if isinstance(record, Metadata) and record.name == "tci":
                self.about = dict(record.metadata)
            if isinstance(record, Message | Metadata):
                break
        if not self.about:
            raise RecordingError(f"{self.path} has no metadata named 'tci'; {VALID}")
        form = self.about.get("format", "1")
        if form not in _FORMATS:
            raise RecordingError(
                f"{self.path} has format {form[:20]!r}; this version of TCI reads {', '.join(_FORMATS)}"
            )
        kinds = (JOINTS, IMU, SKIN, TICK, CLOUD, TRUTH, *_FORMATS[form])
        self._kinds = {kind.name: kind for kind in kinds}

    @property
    def period(self) -> float:
        """Period of the loop [s]. 0 if the file does not contain this number, or contains an impossible
        value."""
        try:
            period = float(self.about.get("period_s", "0"))
        except ValueError:
            return 0.0
        return period if _PERIODS[0] <= period <= _PERIODS[1] else 0.0

    @property
    def keep_alive(self) -> float | None:
        """Longest time [s] between two frames of a patch, if frames are sent only when values change. The
        value is None if every frame is sent.
        """
        try:
            return float(self.about["keep_alive_s"])
        except (KeyError, ValueError):
            return None

    def topics(self) -> dict[str, Topic]:
        """Counts the messages of each topic, also of topics that TCI does not read, without decoding them.

        Reads the whole file, so `lost` and `complete` are valid afterwards.
        """
        names: dict[int, str] = {}
        found: dict[int, list[int]] = {}
        for record in self._records():
            if isinstance(record, Message):
                one = found.setdefault(record.channel_id, [0, record.log_time, record.log_time])
                one[0] += 1
                one[1], one[2] = min(one[1], record.log_time), max(one[2], record.log_time)
            elif isinstance(record, Channel):
                names[record.id] = record.topic
        return {
            names.get(channel, ""): Topic(count, first * 1e-9, last * 1e-9)
            for channel, (count, first, last) in found.items()
        }

    def span(self) -> tuple[float, float]:
        """Returns the times [s] of the first and last message on the recording's clock. Reads the whole file.

        Raises RecordingError if the recording has no messages.
        """
        topics = self.topics().values()
        if not topics:
            raise RecordingError(f"{self.path} has no message")
        return min(one.first for one in topics), max(one.last for one in topics)

    def ticks(self) -> Iterator[RecordedTick]:
        """Yields every complete period, in the order of the file, but for those that need data of a damaged
        part. Raises RecordingError at the first invalid data."""
        state, lost = _State(), 0
        waiting: tuple[float, Reading] | None = None
        commands: list[dict[str, Any]] = []
        decision: dict[str, Any] | None = None
        for _, kind, _, data in self.messages():
            if kind in (CLOUD, TRUTH):
                continue
            if waiting is not None and kind in (JOINTS, IMU, SKIN, TICK):
                yield RecordedTick(*waiting, tuple(commands), decision)
                waiting, commands, decision = None, [], None
            if len(self.lost) > lost:
                state, lost, waiting, commands, decision = _State(), len(self.lost), None, [], None
            fields = decode(kind, data)
            if waiting is None and kind.name in (DECISION.name, COMMAND.name):
                continue  # of a period that is lost
            if kind.name == DECISION.name:
                decision = fields
            elif kind is JOINTS:
                state.joints = fields
            elif kind is IMU:
                state.gravity = to_gravity(fields)
            elif kind is SKIN:
                state.frames[fields["number"]] = to_frame(fields)
            elif kind.name == COMMAND.name:
                commands.append(fields)
            elif not lost or state.has(fields):
                waiting = fields["now"], self._reading(state, fields)
        if waiting is not None:
            yield RecordedTick(*waiting, tuple(commands), decision)

    def touching(self) -> Iterator[tuple[int, dict[str, Array]]]:
        """Yields the time [ns] and the poses (7,) of what touched a simulated robot, for each period with a
        touch: as `World.touching`. Raises RecordingError at the first invalid data."""
        for _, kind, stamp, data in self.messages():
            if kind is TRUTH:
                fields = decode(kind, data)
                poses = fields["poses"].reshape(len(fields["bodies"]), 7)
                yield stamp, dict(zip(fields["bodies"], poses, strict=True))

    def frames(self) -> Iterator[SkinFrame]:
        """Yields every raw frame of the skin, in the order of the file. Raises RecordingError at the first
        invalid data."""
        for _, kind, _, data in self.messages():
            if kind is SKIN:
                yield to_frame(decode(kind, data))

    def messages(self) -> Iterator[tuple[str, MessageType, int, bytes]]:
        """Yields topic, type, time [ns] and bytes of every message that has a type in `schemas`.

        Raises RecordingError if the file is damaged.
        """
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, MessageType | None]] = {}
        for record in self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record.topic, self._kinds.get(schemas.get(record.schema_id, ""))
            elif isinstance(record, Message):
                topic, kind = channels.get(record.channel_id, ("", None))
                if kind is not None:
                    yield topic, kind, record.log_time, record.data

    def _reading(self, state: _State, tick: dict[str, Any]) -> Reading:
        if state.joints is None:
            raise RecordingError(f"{self.path}: a period before any joints")
        try:
            skin = tuple(state.frames[number] for number in tick["skin"].tolist())
        except KeyError as error:
            raise RecordingError(f"{self.path}: a period names patch {error}, which was never sent") from None
        return Reading(to_joints(state.joints, tick, state.gravity), skin)

    def _records(self) -> Iterator[Any]:
        """Yields every record of the file, also the records inside chunks.

        Stops at the end of the file, or at the byte where the file was cut off.
        """
        self.complete, self.lost = False, ()
        with Bounded(io.FileIO(self.path)) as file:
            # Channels and schemas are repeated after the data, which has no effect.
            records = _Records(file, emit_chunks=True, record_size_limit=LARGEST).records
            try:
                try:
                    yield from self._unpacked(records)
                except _Unfinished as found:
                    yield from _inside(_so_far(found.chunk))
            except (EndOfFile, struct.error):
                return  # the file was cut off here: all previous records are complete
            except InvalidMagic:
                raise RecordingError(f"{self.path} is no MCAP file; {VALID}") from None
            except (
                McapError, CRCValidationError, UnicodeDecodeError, OverflowError, zstandard.ZstdError
            ) as error:  # fmt: skip
                raise RecordingError(f"{self.path} is damaged: {error}; {VALID}") from error

    def _unpacked(self, records: Iterator[Any]) -> Iterator[Any]:
        for record in records:
            if isinstance(record, Chunk):
                try:
                    _check_chunk(record)
                    stream, length = get_chunk_data_stream(record, validate_crc=True)
                    data = stream.read(length) if length else b""
                except (McapError, CRCValidationError, zstandard.ZstdError, RecordingError) as error:
                    self._lose(record, str(error))
                    yield from self._definitions()
                    continue
                yield from _inside(data)
            else:
                yield record
                self.complete |= isinstance(record, Footer)

    def _lose(self, chunk: Chunk, reason: str) -> None:
        lost = LostChunk(chunk.message_start_time * 1e-9, chunk.message_end_time * 1e-9, reason)
        self.lost = (*self.lost, lost)
        if lost not in self._told:
            self._told.add(lost)
            _log.warning(f"{self.path}: {lost}; the rest is read")

    def _definitions(self) -> Iterator[Schema | Channel]:
        """Schemas and channels as the end of the file repeats them, since the first chunk has the only
        others. None if the end is missing or damaged, where it may name any place in the file."""
        damaged = (McapError, EndOfFile, struct.error, ValueError, OSError, OverflowError, RecordingError)
        with suppress(*damaged), Bounded(io.FileIO(self.path)) as file:
            summary = SeekingReader(
                file, record_size_limit=min(LARGEST, self.path.stat().st_size)
            ).get_summary()
            if summary is not None:
                yield from summary.schemas.values()
                yield from summary.channels.values()


class _Unfinished(Exception):
    """The file ends in a chunk that was still being written."""

    def __init__(self, chunk: bytes) -> None:
        self.chunk = chunk


class _Records(StreamReader):
    """Reads the records of a file or a chunk, up to the first record that consists of zeros.

    A system that crashed leaves files that end in zeros. If reading did not stop there, every nine zeros
    would count as a record.
    """

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode == 0:  # no record has this opcode
            raise EndOfFile
        if opcode == Opcode.CHUNK and length == OPEN:
            raise _Unfinished(self._stream.read(length))
        if opcode == Opcode.CHUNK:
            return self._read_chunk(length)
        if opcode == Opcode.MESSAGE_INDEX:  # everything is read in its order
            self._stream.read(length)
            return None
        return super()._read_record(opcode, length)

    def _read_chunk(self, length: int) -> Chunk:
        """A chunk; one that is damaged where it says how it is packed names no packing that is known."""
        stream = self._stream
        after = stream.count + length
        begin, end, size, crc = struct.unpack("<QQQI", stream.read(28))
        try:
            packed, data = stream.read_prefixed_string(), stream.read(stream.read8())
        except (UnicodeDecodeError, RecordingError):
            stream.read(max(0, after - stream.count))
            packed, data = "?", b""
        return Chunk(packed, data, end, begin, crc, size)


class Bounded(io.BufferedReader):
    """A file whose `read` raises RecordingError for more than LARGEST bytes, since a damaged record may
    declare any length."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is None or not 0 <= size <= LARGEST:
            raise RecordingError(f"a record declares {size} bytes; valid: 0 to {LARGEST}")
        return super().read(size)


def _inside(chunk: bytes) -> Iterator[Schema | Channel | Message]:
    """Yields the records of an unpacked chunk. Raises EndOfFile where it is cut off."""
    place = 0
    while place < len(chunk):
        opcode, length = _RECORD.unpack_from(chunk, place)
        place += _RECORD.size
        after = place + length
        if opcode == 0 or after > len(chunk):  # see `_Records`
            raise EndOfFile
        if opcode == Opcode.MESSAGE:
            channel, sequence, time, published = _MESSAGE.unpack_from(chunk, place)
            data = chunk[place + _MESSAGE.size : after]
            yield Message(
                channel_id=channel, log_time=time, data=data, publish_time=published, sequence=sequence
            )
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            kind = Schema if opcode == Opcode.SCHEMA else Channel
            yield kind.read(ReadDataStream(io.BytesIO(chunk[place:after])))
        place = after


def _so_far(chunk: bytes) -> bytes:
    """What was written of a chunk that did not end, unpacked."""
    head = io.BytesIO(chunk)
    head.seek(3 * 8 + 4)  # its times, size and checksum, which are known at its end
    compression = head.read(int.from_bytes(head.read(4), "little"))
    head.seek(8, os.SEEK_CUR)
    if compression != b"zstd":
        return b""
    unpack, found = zstandard.ZstdDecompressor().decompressobj(), bytearray()
    with suppress(zstandard.ZstdError):  # it ends here, or is damaged from here on
        while piece := head.read(PIECE):
            found += unpack.decompress(piece)
            if len(found) > LARGEST:
                raise RecordingError(f"a chunk of {len(found)} bytes; valid: at most {LARGEST}")
    return bytes(found)


def _check_chunk(chunk: Chunk) -> None:
    """Raises RecordingError if the chunk would need too much memory."""
    if chunk.compression not in ("", "zstd"):
        raise RecordingError(f"a chunk packed with {chunk.compression[:20]!r}; valid: zstd or none")
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        size = max(size, zstandard.frame_content_size(chunk.data))
    if size > LARGEST:
        raise RecordingError(f"a chunk of {size} bytes; valid: at most {LARGEST}")
