"""Tests of the main commands of the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.command_line import tci
from tci.cli.demo import _touches
from tci.exports.facts import query, read_facts
from tci.lab.experiments.same_touch import SameTouch
from tci.robot.catalogue import load_robot

LISTING = """<generic_robot angle_unit="deg">
  <generic_robot_part name="icub_head">
    <generic_servo id="0"><destination_servo_id>0</destination_servo_id></generic_servo>
  </generic_robot_part>
</generic_robot>
"""


def process(*arguments: str) -> str:
    """Runs a command in a separate process."""
    command = [sys.executable, "-m", "tci.cli.main", *arguments]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def test_help_teaches() -> None:
    text = process("--help")
    assert all(name in text for name in ("demo", "robots", "describe", "check", "certified"))


def test_the_name_of_a_file_does_not_steer_the_terminal(tmp_path: Path) -> None:
    file = tmp_path / "e\x1b[31mvil.xml"
    file.write_text("no description")
    said = tci("describe", str(file), status=1)
    assert "e\\x1b[31mvil.xml: 1 fault\n" in said
    assert "\x1b" not in said


def test_robots() -> None:
    assert "iCub V2.5" in tci("robots")
    rows = {row["name"]: row for row in json.loads(tci("robots", "--json"))["robots"]}
    assert rows["g1-bare"]["skin"] == {}
    assert "left_forearm" in rows["g1-bare"]["through_joints"]
    names = set(rows)
    assert {"nao", "icub"} <= names


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_describe(robot: str) -> None:
    text = tci("describe", robot)
    assert "shoulder_pitch" in text
    assert "rms" in text
    data = json.loads(tci("describe", robot, "--json"))
    assert len(data["patches"]) == {"nao": 7, "icub": 4}[robot]
    fitted = [patch["cone"]["rms"] for patch in data["patches"] if patch["segment"]]
    assert all(0.0 <= rms < 0.006 for rms in fitted)


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_describe_in_every_format(robot: str) -> None:
    facts = json.loads(tci("describe", robot, "--format", "json"))
    told, known = read_facts(json.dumps(facts)), query(load_robot(robot))
    assert told.servos == known.servos
    assert told.links == known.links
    assert [len(patch.taxels) for patch in told.patches] == [len(patch.taxels) for patch in known.patches]
    dh = tci("describe", robot, "--format", "dh")
    assert "classic convention" in dh
    assert "modified convention" in dh
    assert tci("describe", robot, "--format", "urdf").startswith('<?xml version="1.0"?>\n<robot name=')
    chains = json.loads(tci("describe", robot, "--format", "kdl"))
    assert {"left_arm", "right_arm", "head"} <= chains.keys()
    assert "valid: table, json, dh, urdf, kdl" in tci("describe", robot, "--format", "yaml", status=1)


def test_unknown_robot_lists_the_valid_ones() -> None:
    text = tci("describe", "naoo", status=1)
    assert "naoo" in text
    assert "icub" in text
    assert "Traceback" not in text


def test_check_says_what_is_valid_and_what_is_not(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.xml", tmp_path / "bad.xml"
    good.write_text(LISTING)
    assert "valid" in tci("check", str(good))
    bad.write_text(LISTING.replace('angle_unit="deg"', "").replace(">0<", ">none<"))
    text = tci("check", str(bad), status=1)
    assert "line 1" in text
    assert "line 3" in text
    faults = json.loads(tci("check", str(bad), "--json", status=1))["faults"]
    assert {fault["line"] for fault in faults} >= {1, 3}
    assert "can't be opened" in tci("check", str(tmp_path / "none.xml"), status=1)


def test_a_demo_names_the_next_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests only the text after the trials; `test_view.py` runs the trials."""
    monkeypatch.setattr("tci.cli.demo._run_trials", lambda *words, **options: None)
    text = tci("demo", "nao", "--headless", "--out", str(tmp_path))
    assert f"Next: open {tmp_path / 'demo.png'}, then poke" in text


def test_both_numbers_of_the_same_touch_have_a_head() -> None:
    table = _touches([SameTouch("nao", 3.0, 2.0, 1.75, 0.35, True)])
    assert [column.header for column in table.columns] == ["probe\nmm", "pressed\nN", "nao\nN  gain"]
    assert [*table.columns[2].cells] == ["1.75  0.35"]


def test_demo_says_where_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file, no folder")
    text = tci("demo", "nao", "--out", str(tmp_path / "taken"), status=1)
    assert "taken" in text
    assert "Traceback" not in text


def test_demo_refuses_a_bad_skin_rate(tmp_path: Path) -> None:
    text = tci("demo", "nao", "--skin-rate", "-5", "--out", str(tmp_path), status=1)
    assert "-5" in text
    assert not list(tmp_path.iterdir())
