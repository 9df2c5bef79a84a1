from __future__ import annotations

import os
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from helpers.recorded import equal_readings, made_up, record_poke
from tci.errors import RecordingError
from tci.recording.cut import cut
from tci.recording.index import indexed
from tci.recording.recorder import Recorder
from tci.recording.recording import LARGEST, Recording
from tci.recording.schemas import to_nanoseconds


def write(path: Path, count: int, *, closed: bool = True) -> None:
    recorder = Recorder(path, None)
    for now, reading in made_up(count):
        recorder.tick(now, reading)
    if closed:
        recorder.close()
    else:  # as if the process had been killed
        recorder._file.close()


def test_a_minute_is_small_and_opens_in_mcap(tmp_path: Path) -> None:
    path = tmp_path / "minute.mcap"
    write(path, 6000)
    assert path.stat().st_size < 10e6
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 3 * 6000
    with path.open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    assert sum(isinstance(record, Message) for record in records) == 3 * 6000
    with path.open("rb") as file:
        times = [m.log_time for *_, m in make_reader(file, validate_crcs=True).iter_messages("/skin/skin")]
    assert np.array_equal(times, [to_nanoseconds(now) for now, _ in made_up(6000)])


def test_other_programs_read_it_without_our_code(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap")
    topics: dict[str, list[object]] = {}
    with (tmp_path / "a.mcap").open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append(message)
    states = topics["/joint_states"]
    assert len(states) == len(ticks)
    np.testing.assert_array_equal(states[-1].position, ticks[-1].reading.joints.position)
    cloud = topics["/skin/points"][-1]
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "pressure"]
    points = np.frombuffer(bytes(cloud.data), dtype="<f4").reshape(-1, 4)
    assert len(points) == cloud.width > 100
    assert np.all(np.abs(points[:, :3]) < 1.0)
    pressed = np.concatenate(
        [np.frombuffer(bytes(each.data), dtype="<f4")[3::4] for each in topics["/skin/points"]]
    )
    assert pressed.max() > 0.0, "the poke is seen"


def test_a_cut_begins_with_what_was_known(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", duration=0.2)
    cut(tmp_path / "a.mcap", tmp_path / "b.mcap", begin=0.05, end=0.1)
    found = list(Recording(tmp_path / "b.mcap").ticks())
    kept = [tick for tick in ticks if 0.05 <= tick.now < 0.1]
    assert len(found) == len(kept)
    assert all(equal_readings(a.reading, b.reading) for a, b in zip(found, kept, strict=True))


def test_a_recording_whose_process_was_killed_is_made_whole_for_other_programs(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", 1500, closed=False)
    cut(tmp_path / "a.mcap", tmp_path / "b.mcap")
    with (tmp_path / "b.mcap").open("rb") as file:
        found = [one for one in StreamReader(file, validate_crcs=True).records if isinstance(one, Message)]
    assert len(found) == 3 * 1500
    assert Recording(tmp_path / "b.mcap").topics()["/tci/tick"].messages == 1500


@pytest.mark.parametrize("closed", [True, False])
def test_58_cut_off_anywhere_it_gives_whole_periods_or_one_error(closed: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, 30, closed=closed)
    raw = path.read_bytes()
    readings = made_up(30)
    for length in [*range(0, 400, 7), *range(400, len(raw), len(raw) // 60)]:
        path.write_bytes(raw[:length])
        try:
            found = list(Recording(path).ticks())
        except RecordingError:
            continue
        for tick, (_, reading) in zip(found, readings, strict=False):
            assert equal_readings(tick.reading, reading)


@pytest.mark.parametrize("closed", [True, False])
def test_58_a_damaged_recording_raises_nothing_else(closed: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, 5, closed=closed)
    raw = path.read_bytes()
    random = np.random.default_rng(7)
    for _ in range(300):
        damaged = bytearray(raw)
        for place in random.integers(0, len(raw), random.integers(1, 6)):
            damaged[place] = random.integers(0, 256)
        path.write_bytes(damaged)
        try:
            for tick in Recording(path).ticks():
                assert tick.reading.joints.position.size <= len(raw)
            indexed(path)
        except RecordingError:
            pass


def test_the_index_says_what_is_there_and_a_file_without_one_says_so(tmp_path: Path) -> None:
    path, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    write(path, 500)
    assert indexed(path) == Recording(path).topics()
    cut.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordingError, match="index"):
        indexed(cut)


def test_58_a_bomb_is_refused_before_it_unpacks(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=10 * LARGEST)
        writer.start()
        writer.add_metadata("tci", {"robot": ""})
        channel = writer.register_channel("/x", "cdr", 0)
        writer.add_message(channel, 0, bytes(LARGEST + 1), 0)
        writer.finish()
    assert path.stat().st_size < LARGEST // 1000
    recording = Recording(path)
    assert not list(recording.ticks())
    assert "at most" in recording.lost[0].reason


@pytest.mark.timeout(120)
@pytest.mark.parametrize(("chunks", "closed"), [(0, True), (47, True), (0, False)])
def test_58_gigabytes_of_nothing_end_soon(chunks: int, closed: bool, tmp_path: Path) -> None:
    """The recording ends with 3 GB of zero bytes (a hole in the file), with and without chunks inside."""
    path = tmp_path / "a.mcap"
    write(path, 30, closed=closed)
    raw, end = path.read_bytes(), 8
    while end < len(raw) and raw[end] != Opcode.DATA_END:
        end += 9 + struct.unpack_from("<Q", raw, end + 1)[0]
    end = min(end, len(raw))
    with path.open("r+b") as file:
        file.truncate(end)
        file.seek(end)
        for _ in range(chunks):
            size = (LARGEST - 100) // 9 * 9  # whole records of zeros
            file.write(struct.pack("<BQQQQIIQ", 6, size + 40, 0, 0, size, 0, 0, size))
            file.seek(size, os.SEEK_CUR)
        file.truncate(3 << 30)
    begin = time.process_time()
    recording = Recording(path)
    assert len(list(recording.ticks())) == 30
    assert not recording.complete
    assert time.process_time() - begin < 10.0


def test_a_file_of_another_kind_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("this is a letter to a friend, and no recording")
    with pytest.raises(RecordingError, match=r"a\.mcap is no MCAP file; valid: a recording of TCI"):
        Recording(path)
    path.write_bytes(zstandard.compress(b"x" * 100))
    with pytest.raises(RecordingError, match=r"a\.mcap is no MCAP file; valid: a recording of TCI"):
        Recording(path)


@pytest.mark.parametrize("size", [2**31 - 1, 2**40, 2**63, 2**64 - 1])
def test_31_a_declared_length_takes_no_memory(size: int, tmp_path: Path) -> None:
    chunk = struct.pack("<QQQIIQ", 0, 0, 10, 0, 0, size)
    file = tmp_path / "a.mcap"
    file.write_bytes(b"\x89MCAP0\r\n\x06" + struct.pack("<Q", len(chunk)) + chunk)
    with pytest.raises(RecordingError, match=r"valid|no recording"):
        list(Recording(file).ticks())


def test_what_lies_before_and_after_a_damaged_chunk_is_read_and_what_is_lost_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.mcap"
    write(path, 4000)
    raw, all_of_it = path.read_bytes(), made_up(4000)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    places = [one.chunk_start_offset + one.chunk_length // 2 for one in summary.chunk_indexes]
    assert len(places) >= 3
    header = 9 + 3 * 8 + 4  # then how it is packed, and how long the rest is
    places += [
        summary.chunk_indexes[1].chunk_start_offset + at for at in (28, header, header + 5, header + 16)
    ]
    random = np.random.default_rng(3)
    for place in places:
        damaged = bytearray(raw)
        damaged[place] ^= 64 if place in places[-4:] else 1 << int(random.integers(8))
        path.write_bytes(damaged)
        caplog.clear()
        recording = Recording(path)
        found = {tick.now: tick.reading for tick in recording.ticks()}
        assert len(recording.lost) == 1
        assert caplog.messages == [f"{path}: {recording.lost[0]}; the rest is read"]
        lost = [now for now, _ in all_of_it if now not in found]
        begin, end = recording.lost[0].begin, recording.lost[0].end
        assert begin - 0.05 <= min(lost) <= max(lost) <= end + 0.05
        for now, reading in all_of_it:
            assert now not in found or equal_readings(found[now], reading)


@pytest.mark.parametrize("start", [2**64 - 1, 2**63 - 1, 5])
def test_58_an_end_that_names_a_place_outside_the_file_is_not_used(start: int, tmp_path: Path) -> None:
    """The end is looked at only where a chunk is damaged: here the first one, so nothing is left to read."""
    path = tmp_path / "a.mcap"
    write(path, 20)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    raw, chunk = bytearray(path.read_bytes()), summary.chunk_indexes[0]
    raw[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    struct.pack_into("<Q", raw, len(raw) - 28, start)  # a footer has 20 bytes, and 8 follow
    path.write_bytes(raw)
    recording = Recording(path)
    assert not list(recording.ticks())
    assert len(recording.lost) == 1
