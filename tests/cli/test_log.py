"""`tci record` and `tci log`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers.command_line import tci
from tci import film as film_recording
from tci.cli.main import app
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.testing import FakeDriver


def test_record_look_cut_export_and_replay(tmp_path: Path) -> None:
    path = str(tmp_path / "touch.mcap")
    run = ("run", "withdrawal", "nao", "--json")
    told = json.loads(tci(*run, "--duration", "0.6", "--poke", "--record", path))
    assert told["recording"]["failed"] == ""
    assert told["recording"]["periods"] == 300
    again = json.loads(tci(*run, "--via", f"replay:{path}"))
    assert again["replay"] == {"compared": 300, "different": 0, "other_versions": []}
    assert "bit for bit" in tci(*run[:-1], "--via", f"replay:{path}")

    info = json.loads(tci("log", "info", path, "--json"))
    assert info["complete"]
    assert info["periods"] == info["topics"]["/tci/decision"] == 300
    quick = json.loads(tci("log", "info", path, "--json", "--quick"))
    assert quick == {**info, "checked": False}
    about = info["about"]
    assert (about["capability"], about["robot"], about["middleware"]) == ("withdrawal", "nao", "sim")
    assert (about["seed"], about["step_s"], about["period_s"]) == ("0", "0.001", "0.002")
    assert "refractory=0.5" in about["settings"]
    assert {"tci", "numpy", "mujoco", "python"} < set(json.loads(about["versions"]))
    description = Recording(path).about["description"]
    assert description.startswith("{")
    assert "_touch.csv" not in description, "files of this machine"
    shown = tci("log", "info", path)
    assert "/joint_states" in shown
    assert f"of WithdrawalReflex; all values: tci log info {path} --json" in shown.replace("\n", "")

    tci("log", "cut", path, str(tmp_path / "cut.mcap"), "--from", "0.2", "--to", "0.4")
    assert json.loads(tci("log", "info", str(tmp_path / "cut.mcap"), "--json"))["periods"] == 100
    assert "exists" in tci("log", "cut", path, path, status=1)
    assert tci("log", "info", "no.mcap", status=1).strip() == "tci: no.mcap: No such file or directory"
    assert "valid: within 0.000 to 0.598 s" in tci("log", "cut", path, f"{path}.x", "--from", "7", status=1)
    assert "valid: 0.000 to 0.598 s" in tci("plot", path, "--from", "7", "--to", "8", status=1)
    assert json.loads(tci("log", "touches", path, str(tmp_path / "felt.tsv"), "--json"))["touches"] == 1
    assert "\ttap\tleft forearm " in (tmp_path / "felt.tsv").read_text()
    assert "exists" in tci("log", "touches", path, str(tmp_path / "felt.tsv"), status=1)
    film = tmp_path / "touch.gif"
    filmed = json.loads(tci("film", path, str(film), "--from", "0.3", "--to", "0.35", "--json"))
    assert filmed["pictures"] == 3
    again = tmp_path / "again.gif"
    assert film_recording(path, again, part="left_arm", begin=0.3, end=0.35) == 3
    assert again.read_bytes() == film.read_bytes()
    assert "valid: within 0.000 to 0.598 s" in tci("film", path, f"{film}.gif", "--from", "7", status=1)
    matrices = tmp_path / "touch.npz"  # the suffix of the file name selects the format
    tci("log", "export", path, str(matrices))
    assert matrices.is_file()
    written = tci("log", "export", path, str(tmp_path / "tables"))
    assert "joints.csv" in written
    assert "contacts.csv" in written


def test_an_export_says_why_it_has_no_forces(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", None) as recorder:
        joints = JointReading(0.0, 0, np.zeros(0), np.zeros(0))
        recorder.tick(0.0, Reading(joints, (SkinFrame("foot", 0.0, 0, np.zeros(3)),)))
    words = ["log", "export", str(tmp_path / "a.mcap"), str(tmp_path / "tables")]
    result = CliRunner().invoke(app, words)
    assert "raw values only, without forces: the recording does not name its robot" in result.output
    assert [path.name for path in (tmp_path / "tables").iterdir()] == ["skin_foot.csv"]


def test_record_a_robot_that_nobody_commands(tmp_path: Path) -> None:
    path = str(tmp_path / "rest.mcap")
    told = json.loads(tci("record", path, "nao", "--duration", "0.1", "--json"))
    assert (told["periods"], told["missed"]) == (50, 0)
    assert "exists" in tci("record", path, "nao", status=1)
    assert "the recording has none" in tci("run", "withdrawal", "nao", "--via", f"replay:{path}")


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_periods_that_a_recording_missed_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    class Stands(FakeDriver):
        """Its tenth reading comes a tenth of a second late."""

        count = 0

        def read(self) -> Reading:
            self.count += 1
            if self.count == 10:
                self.clock.sleep_until(self.clock.now() + 0.1)
            return super().read()

    monkeypatch.setattr("tci.drivers.registry.connect", lambda robot, *a, **k: Stands(robot, rate=100.0))
    told = tci("record", str(tmp_path / "a.mcap"), "nao", "--duration", "0.5", *words)
    if words:
        assert json.loads(told)["periods"] + json.loads(told)["missed"] == 50
        assert 9 <= json.loads(told)["missed"] <= 10
    else:
        assert any(f"{n} missed" in told for n in (9, 10))
