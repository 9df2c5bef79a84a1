"""`tci gesture record` and `convert`: no recorded posture is lost."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from tci.cli.main import app, main
from tci.errors import CommandError, DriverError
from tci.gestures.files import read_csv
from tci.messages import Reading
from tci.robot.description import Robot
from tci.testing import FakeDriver


class Breaking(FakeDriver):
    """A robot whose angles are invalid for some time, and whose connection ends at `END` [s]."""

    END = 0.5

    def read(self) -> Reading:
        if self.clock.now() >= self.END:
            raise DriverError("the robot is away")
        reading = super().read()
        if not 0.1 < self.clock.now() < 0.15:
            return reading
        unknown = np.full_like(reading.joints.position, np.nan)
        return replace(reading, joints=replace(reading.joints, position=unknown))


@pytest.fixture
def breaking(monkeypatch: pytest.MonkeyPatch) -> type[Breaking]:
    def connect(robot: Robot, via: str, **options: Any) -> Breaking:
        return Breaking(robot)

    monkeypatch.setattr("tci.drivers.registry.connect", connect)
    return Breaking


def test_what_was_shown_before_the_robot_went_away_is_kept(breaking: type[Breaking], tmp_path: Path) -> None:
    file = tmp_path / "wave.csv"
    result = CliRunner().invoke(app, ["gesture", "record", str(file), "nao"])
    assert isinstance(result.exception, DriverError)
    gesture, _ = read_csv(file)
    assert breaking.END - 0.05 < gesture.duration < breaking.END
    assert f"has the {len(gesture.times)} postures before the error" in result.stderr


def test_sigterm_ends_it_as_ctrl_c_does(
    breaking: type[Breaking],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def read(driver: Breaking) -> Reading:
        if driver.clock.now() >= 0.3:
            os.kill(os.getpid(), signal.SIGTERM)
        return super(Breaking, driver).read()

    monkeypatch.setattr(breaking, "read", read)
    file = tmp_path / "wave.csv"
    monkeypatch.setattr("sys.argv", ["tci", "gesture", "record", str(file), "nao", "--json"])
    before = signal.getsignal(signal.SIGTERM)
    try:
        with pytest.raises(SystemExit) as end:
            main()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert not end.value.code
    assert json.loads(capsys.readouterr().out)["postures"] == len(read_csv(file)[0].times) == 15


def test_a_robot_that_shows_nothing_leaves_no_file(
    breaking: type[Breaking], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(breaking, "END", 0.0)
    result = CliRunner().invoke(app, ["gesture", "record", str(tmp_path / "wave.csv"), "nao"])
    assert isinstance(result.exception, DriverError)
    assert not list(tmp_path.iterdir())


def test_recording_ends_where_a_gesture_would_be_too_long(
    breaking: type[Breaking], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tci.gestures.gesture.LONGEST", 0.2)
    result = CliRunner().invoke(app, ["gesture", "record", str(tmp_path / "wave.csv"), "nao"])
    assert result.exit_code == 0, result.output
    assert read_csv(tmp_path / "wave.csv")[0].duration == pytest.approx(0.2, abs=0.021)


@pytest.mark.parametrize("command", ["record", "convert"])
def test_a_gesture_that_exists_is_kept(command: str, tmp_path: Path) -> None:
    source, target = tmp_path / "a.csv", tmp_path / "b.csv"
    source.write_text("time_s,head.yaw_deg\n0,1\n1,2\n")
    target.write_text("mine")
    words = [str(target), "nao", "--duration", "0.1"] if command == "record" else [str(source), str(target)]
    result = CliRunner().invoke(app, ["gesture", command, *words])
    assert isinstance(result.exception, CommandError)
    assert f"{target} exists and is not replaced; valid: a new file name" in str(result.exception)
    assert target.read_text() == "mine"
