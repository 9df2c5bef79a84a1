"""Writes an MCAP file (https://mcap.dev/spec) that is compressed while it grows.

Messages go into chunks. What a chunk has is compressed and handed to the operating system with each `flush`,
so a killed process loses nothing that it flushed. A chunk's length is unknown until it ends: until then the
file says `OPEN`, which is more than it has. Other programs take such a chunk for cut off; `Recording` reads
what is there.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from tci.recording.rosmsg.cdr import MessageType

MAGIC = b"\x89MCAP0\r\n"
OPEN = 64 * 2**20
"""Length of a chunk that has not ended. Readers refuse or do not find so much: chunks end far below."""
CHUNK = 2**20
"""Size [bytes], before compression, after which a chunk ends: the default of MCAP's own writers."""
PACKED = "zstd"

_MESSAGE = struct.Struct("<BQHIQQ")
_CHUNK = struct.Struct(f"<BQQQQII{len(PACKED)}sQ")
_LENGTH = struct.Struct("<Q")
_HEAD = struct.calcsize("<BQ")
"""Bytes of a record before its contents: kind and length."""


class GrowingMcap:
    """Writes one new file. All methods may raise OSError; then the file holds all that was flushed before."""

    def __init__(self, path: Path, *, library: str) -> None:
        self._file = _Out(path)
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._chunk: _Chunk | None = None
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._append(MAGIC)
        self._append(_bytes(Header(profile="ros2", library=library)))

    def describe(self, name: str, words: Mapping[str, str]) -> None:
        """Adds metadata. Valid before the first message."""
        record = _bytes(Metadata(name=name, metadata=dict(words)))
        self._metadata.append(MetadataIndex(offset=self._file.tell(), length=len(record), name=name))
        self._append(record)

    def put(self, topic: str, kind: MessageType, stamp: int, data: bytes) -> None:
        """Adds a message with the time `stamp` [ns]. A topic gets its channel with its first message."""
        chunk = self._chunk
        if chunk is None:
            chunk = self._chunk = _Chunk(self._file.tell())
            self._file.write(chunk.head(OPEN))
        if topic not in self._channels:
            self._file.write(chunk.add(self._register(topic, kind)))
        channel = self._channels[topic].id
        self._counts[channel] += 1
        chunk.see(channel, stamp)
        head = _MESSAGE.pack(Opcode.MESSAGE, len(data) + _MESSAGE.size - _HEAD, channel, 0, stamp, stamp)
        self._file.write(chunk.add(head + data))

    def flush(self) -> None:
        """Hands all messages to the operating system. A killed process loses none of them."""
        chunk = self._chunk
        if chunk is not None and chunk.size < CHUNK:
            self._file.write(chunk.flush())
        elif chunk is not None:
            self._end(chunk)
        self._file.flush()

    def finish(self) -> None:
        """Adds the index."""
        if self._chunk is not None:
            self._end(self._chunk)
        self._file.write(_bytes(DataEnd(data_section_crc=self._crc)))
        begin = self._file.tell()
        summary, offsets = b"", list[McapRecord]()
        for code, records in (
            (Opcode.SCHEMA, self._schemas.values()),
            (Opcode.CHANNEL, self._channels.values()),
            (Opcode.STATISTICS, (self._statistics(),)),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        ):
            group = _bytes(*records)
            if group:
                offsets.append(
                    SummaryOffset(
                        group_opcode=code, group_start=begin + len(summary), group_length=len(group)
                    )
                )
            summary += group
        after = begin + len(summary)
        summary += _bytes(*offsets)
        head = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, begin, after)
        self._file.write(summary)
        crc = zlib.crc32(head, zlib.crc32(summary))
        self._file.write(_bytes(Footer(summary_start=begin, summary_offset_start=after, summary_crc=crc)))
        self._file.write(MAGIC)
        self._file.flush()

    def cut(self) -> None:
        """Forgets what was not flushed."""
        self._file.cut()

    def close(self) -> None:
        self._file.close()

    def _append(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._file.write(data)

    def _register(self, topic: str, kind: MessageType) -> bytes:
        """Makes a topic's channel. Returns the records that other programs need to read it."""
        new: list[McapRecord] = []
        if kind.name not in self._schemas:
            number = len(self._schemas) + 1
            definition = kind.definition.encode()
            self._schemas[kind.name] = Schema(id=number, name=kind.name, encoding="ros2msg", data=definition)
            new.append(self._schemas[kind.name])
        self._channels[topic] = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="cdr",
            metadata={},
            schema_id=self._schemas[kind.name].id,
        )
        return _bytes(*new, self._channels[topic])

    def _end(self, chunk: _Chunk) -> None:
        """The length of the chunk is written last: before, a kill leaves an open chunk that is read."""
        self._file.write(chunk.flush(last=True))
        self._file.flush()
        length = _CHUNK.size - _HEAD + chunk.packed_size
        head = chunk.head(length)
        self._file.replace(chunk.begin + _HEAD, head[_HEAD:])
        self._file.replace(chunk.begin + 1, _LENGTH.pack(length))
        self._crc = zlib.crc32(chunk.packed, zlib.crc32(head, self._crc))
        offsets, begin = {}, self._file.tell()
        for channel, entries in chunk.index.items():
            offsets[channel] = self._file.tell()
            self._append(_bytes(MessageIndex(channel_id=channel, records=entries)))
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.first, message_end_time=chunk.last,
                chunk_start_offset=chunk.begin, chunk_length=_HEAD + length,
                message_index_offsets=offsets, message_index_length=self._file.tell() - begin,
                compression=PACKED, compressed_size=chunk.packed_size, uncompressed_size=chunk.size,
            )
        )  # fmt: skip
        self._chunk = None

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=max((one.message_end_time for one in self._chunks), default=0),
            message_start_time=min((one.message_start_time for one in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


class _Chunk:
    """Compresses the records of one chunk."""

    def __init__(self, begin: int) -> None:
        self.begin = begin
        self.size = 0
        self.first, self.last = 2**63, 0
        self.index: dict[int, list[tuple[int, int]]] = {}
        self.packed = bytearray()
        self._crc = 0
        self._pack = zstandard.ZstdCompressor(level=3).compressobj()

    @property
    def packed_size(self) -> int:
        return len(self.packed)

    def see(self, channel: int, stamp: int) -> None:
        """Indexes the message that comes next."""
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)
        self.index.setdefault(channel, []).append((stamp, self.size))

    def add(self, record: bytes) -> bytes:
        """Returns what is to be written now, which may be nothing."""
        self.size += len(record)
        self._crc = zlib.crc32(record, self._crc)
        return self._packed(self._pack.compress(record))

    def flush(self, *, last: bool = False) -> bytes:
        how = zstandard.COMPRESSOBJ_FLUSH_FINISH if last else zstandard.COMPRESSOBJ_FLUSH_BLOCK
        return self._packed(self._pack.flush(how))

    def head(self, length: int) -> bytes:
        """The chunk's record up to its compressed data."""
        size = OPEN if length == OPEN else self.packed_size
        return _CHUNK.pack(
            Opcode.CHUNK, length, min(self.first, self.last), self.last, self.size, self._crc, len(PACKED),
            PACKED.encode(), size,
        )  # fmt: skip

    def _packed(self, data: bytes) -> bytes:
        self.packed += data
        return data


class _Out:
    """A new file. Data is passed to the operating system only by `flush` and `replace`."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
        self._waiting = bytearray()
        self._good = 0

    def write(self, data: bytes) -> None:
        self._waiting += data

    def tell(self) -> int:
        return self._good + len(self._waiting)

    def flush(self) -> None:
        while self._waiting:
            self._good += self._write(self._waiting)

    def replace(self, place: int, data: bytes) -> None:
        """Overwrites bytes that were flushed before."""
        os.lseek(self._fd, place, os.SEEK_SET)
        left = bytearray(data)
        while left:
            self._write(left)
        os.lseek(self._fd, self._good, os.SEEK_SET)

    def cut(self) -> None:
        self._waiting.clear()

    def close(self) -> None:
        os.close(self._fd)

    def _write(self, data: bytearray) -> int:
        """Writes the beginning of `data` and removes it."""
        written = os.write(self._fd, data)
        if not written:
            raise OSError("nothing could be written")
        del data[:written]
        return written


def _bytes(*records: McapRecord) -> bytes:
    builder: Any = RecordBuilder()  # some functions of mcap have no type annotations
    for record in records:
        record.write(builder)
    written: bytes = builder.end()
    return written
