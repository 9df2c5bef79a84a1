from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers import TESTS
from helpers.recorded import equal_readings, made_up, record_poke, two_parts
from helpers.small_robot import build
from helpers.xml_sample import GOOD
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import RecordingError
from tci.gate.gate import Gate
from tci.messages import GenericCommand, JointReading, Mode, PlatformCommand, Reading, SkinFrame
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import decode
from tci.recording.schemas import COMMAND, command_bytes, same_decision
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_all_that_passed_through_the_loop_is_read_back_bit_for_bit(robot: str, tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", robot=robot)
    recording = Recording(tmp_path / "a.mcap")
    found = list(recording.ticks())
    assert recording.complete
    assert [tick.now for tick in found] == [tick.now for tick in ticks]
    for then, now in zip(ticks, found, strict=True):
        assert equal_readings(then.reading, now.reading)
        assert same_decision(then.sent, now.decision)
        assert len(now.commands) == len(then.commands)
    assert any(tick.commands for tick in found), "the poke was answered"
    assert recording.about["robot"] == robot


def test_gravity_is_read_back_and_its_end_too(tmp_path: Path) -> None:
    robot, given = load_robot("nao"), [None, [0.1, -0.2, -9.7], [0.0, 0.0, -9.8], None]
    angles = np.zeros(len(robot.servos))
    with Recorder(tmp_path / "a.mcap", robot) as recorder:
        for k, gravity in enumerate(given):
            value = None if gravity is None else np.array(gravity)
            recorder.tick(0.1 * k, Reading(JointReading(0.1 * k, k, angles, angles, gravity=value), ()))
    found = [tick.reading.joints.gravity for tick in Recording(tmp_path / "a.mcap").ticks()]
    assert [None if gravity is None else gravity.tolist() for gravity in found] == given


@pytest.mark.parametrize("values", [["touch", "none"], [b"touch"], [True, False], [1.5]])
def test_a_frame_that_no_robot_should_send_is_read_back_too(values: list[object], tmp_path: Path) -> None:
    """The gate refuses frames that contain text (fault 35). The recording must contain these frames."""
    robot, path = two_parts(tmp_path), tmp_path / "a.mcap"
    zeros = np.zeros(len(robot.servos))
    joints = JointReading(0.0, 0, zeros, zeros)
    reading = Reading(joints, (SkinFrame("skin", 0.0, 0, np.array(values)),))
    gate = Gate(robot, period=0.01, stale_after=0.1)
    with Recorder(path, robot) as recorder:
        recorder.tick(0.0, reading, (), gate.step([], joints, 0.0))
    [tick] = Recording(path).ticks()
    assert equal_readings(tick.reading, reading)


def test_44_the_hash_of_the_description_is_in_the_file(tmp_path: Path) -> None:
    robot = load_robot("nao")
    with Recorder(tmp_path / "a.mcap", robot):
        pass
    assert Recording(tmp_path / "a.mcap").about["description_sha256"] == robot.digest


def test_44_a_description_that_is_edited_on_disk_counts_from_the_next_loading_on(tmp_path: Path) -> None:
    source = tmp_path / "robot.xml"
    full = '<velocity max="200"/><acceleration max="900"/><jerk max="9000"/>'
    text = GOOD.replace('<velocity max="200"/>', full)
    source.write_text(text)
    robot = load_robot(str(source))
    gate = Gate(robot, period=0.01, stale_after=0.1)
    source.write_text(text.replace('max="90"', 'max="45"', 1))
    zeros = np.zeros(len(robot.servos))
    far = PlatformCommand(Mode.POSITION, np.array([0]), np.array([1.5]), np.array([np.inf]))
    safe = gate.step([far], JointReading(0.0, 0, zeros, zeros), 0.0)
    assert (safe.clamped, safe.refusals) == ((), ()), "86 degrees are still allowed"
    again = load_robot(str(source))
    assert again.servos[0].limits.upper == pytest.approx(np.deg2rad(45))
    assert again.digest != robot.digest


def test_a_file_that_exists_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(RecordingError, match="exists"):
        Recorder(path, None)
    assert path.read_text() == "mine"
    with pytest.raises(RecordingError, match="no recording at"):
        Recorder(tmp_path / "nowhere" / "a.mcap", None)


@pytest.mark.parametrize("room", [0, 100, 20_000, 100_001])
def test_39_a_full_disk_ends_the_recording_not_the_caller(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = room
    write = os.write

    def full(fd: int, data: bytes) -> int:
        nonlocal left
        if not left:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = write(fd, bytes(data[:left]))
        left -= done
        return done

    monkeypatch.setattr("tci.recording.growing.os.write", full)
    recorder = Recorder(tmp_path / "a.mcap", None)
    readings = made_up(1000)
    for now, reading in readings:
        recorder.tick(now, reading)
    recorder.close()
    assert recorder.failed.startswith("ended early: ")
    assert "No space left" in recorder.failed
    assert recorder.ticks < 1000
    if recorder.ticks:
        found = list(Recording(tmp_path / "a.mcap").ticks())
        assert len(found) >= recorder.ticks
        assert all(
            equal_readings(tick.reading, reading) for tick, (_, reading) in zip(found, readings, strict=False)
        )


def test_the_recording_of_a_robot_without_a_model_is_packed(tmp_path: Path) -> None:
    readings = made_up(300, servos=3)
    with Recorder(tmp_path / "a.mcap", two_parts(tmp_path)) as recorder:
        for now, reading in readings:
            recorder.tick(now, reading)
        size = recorder.path.stat().st_size
    assert not recorder.failed
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.ticks())) == 300
    assert recording.complete
    assert size <= recorder.path.stat().st_size < sum(len(data) for *_, data in recording.messages()) / 2


def test_a_model_that_can_not_be_used_any_more_leaves_the_recording_whole(tmp_path: Path) -> None:
    robot = build(tmp_path)
    assert robot.model is not None
    perceiver = Perceiver(GenericBody(robot))
    Path(robot.model.path).write_text("<mujoco/>")
    with Recorder(tmp_path / "a.mcap", robot) as recorder:
        for now, reading in made_up(3, servos=10):
            reading = replace(reading, skin=())
            recorder.tick(now, reading, perception=perceiver.step(reading, now))
    assert not recorder.failed
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.ticks())) == 3
    assert recording.complete
    assert "/skin/points" not in recording.topics()


def test_the_geometry_of_the_skin_is_ready_before_the_first_period(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On iCub it takes two periods of 5 ms."""
    robot = load_robot("icub")
    perceiver = Perceiver(GenericBody(robot))
    with tci.connect(robot) as driver, Recorder(tmp_path / "a.mcap", robot) as recorder:
        monkeypatch.setattr("tci.skin.skin.Skin.__init__", lambda *_: pytest.fail("built in a period"))
        reading = driver.read()
        recorder.tick(0.0, reading, perception=perceiver.step(reading, 0.0))
    assert "/skin/points" in Recording(tmp_path / "a.mcap").topics()


WRITER = """
import os, sys
sys.path.insert(0, {tests!r})
from helpers.recorded import made_up
from tci.recording.recorder import Recorder
recorder = Recorder({path!r}, None)
for number, (now, reading) in enumerate(made_up(3000)):
    recorder.tick(now, reading)
    os.write(1, b"%d\\n" % number)
"""


@pytest.mark.parametrize("lines", [1, 57, 400])
def test_38_killed_with_minus_9_at_most_the_last_period_is_lost(lines: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    code = WRITER.format(tests=str(TESTS), path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        for _ in range(lines):
            writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)
        acknowledged = lines + writer.stdout.read().count(b"\n")
    recording = Recording(path)
    found = list(recording.ticks())
    assert not recording.complete
    assert acknowledged <= len(found) <= acknowledged + 1
    assert [tick.now for tick in found] == [number * 0.01 for number in range(len(found))]


def test_the_speed_of_a_command_is_recorded(tmp_path: Path) -> None:
    speeds = (None, 0.3, np.array([0.1, 0.2, 0.3, 0.4, 0.5]))
    orders = [GenericCommand("left_arm", Mode.POSITION, np.zeros(5), speed) for speed in speeds]
    decoded = [decode(COMMAND, command_bytes(0.0, order))["speed"].tolist() for order in orders]
    assert decoded == [[], [0.3], [0.1, 0.2, 0.3, 0.4, 0.5]]
