"""What the index at the end of a recording says: milliseconds, however long the recording is."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import ChunkIndex

from tci.errors import RecordingError
from tci.recording.recording import VALID, Bounded, Topic

_ENTRIES = struct.Struct("<BQHI")
"""What an index of messages begins with: kind, length, channel, and bytes of its entries."""


def indexed(path: Path) -> dict[str, Topic]:
    """As `Recording.topics`, but whether the messages can be read is not looked at.

    Raises RecordingError if the index is missing, as in a recording that was cut off, or damaged.
    """
    with Bounded(io.FileIO(path)) as file:
        try:
            summary = SeekingReader(file, record_size_limit=path.stat().st_size).get_summary()
            if summary is None or summary.statistics is None:
                raise RecordingError(f"{path} has no index; valid: without --quick, or tci log cut")
            counts = summary.statistics.channel_message_counts
            return {
                channel.topic: Topic(counts[number], *_span(file, number, summary.chunk_indexes))
                for number, channel in summary.channels.items()
                if counts.get(number)
            }
        except (
            McapError, EndOfFile, struct.error, ValueError, OverflowError, OSError
        ) as error:  # fmt: skip
            raise RecordingError(f"{path} has a damaged index: {error!r}; {VALID}") from error


def _span(file: Bounded, channel: int, chunks: list[ChunkIndex]) -> tuple[float, float]:
    """Times [s] of the first and the last message of a channel: those of few chunks are read."""
    own = [one for one in chunks if channel in one.message_index_offsets]
    first = last = None
    for one in sorted(own, key=lambda one: one.message_start_time):
        if first is not None and one.message_start_time >= first:
            break
        begin = int(_times(file, one.message_index_offsets[channel], channel).min())
        first = begin if first is None else min(first, begin)
    for one in sorted(own, key=lambda one: -one.message_end_time):
        if last is not None and one.message_end_time <= last:
            break
        end = int(_times(file, one.message_index_offsets[channel], channel).max())
        last = end if last is None else max(last, end)
    if first is None or last is None:
        raise ValueError(f"channel {channel} is in no chunk")
    return first * 1e-9, last * 1e-9


def _times(file: Bounded, place: int, channel: int) -> np.ndarray[tuple[int], np.dtype[np.uint64]]:
    """Times (k,) [ns] in an index of messages."""
    file.seek(place)
    code, _, own, size = _ENTRIES.unpack(file.read(_ENTRIES.size))
    data = file.read(size)
    if code != Opcode.MESSAGE_INDEX or own != channel or not data or size % 16 or len(data) < size:
        raise ValueError(f"no index of channel {channel} at byte {place}")
    return np.frombuffer(data, "<u8")[::2]
