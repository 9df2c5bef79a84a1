"""`tci doctor`, and `tci check --hardware`."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import pytest

from helpers.command_line import tci
from helpers.served import Served, needs_qi


def test_this_machine() -> None:
    told = json.loads(tci("doctor", "--json"))
    assert told["healthy"]
    assert {"machine", "clock", "driver sim"} <= {finding["subject"] for finding in told["findings"]}


def test_a_robot_its_streams_and_a_table() -> None:
    told = json.loads(tci("doctor", "nao", "--duration", "0.5", "--json"))
    assert (told["counts"]["ok"], told["counts"]["fault"]) == (12, 0)
    assert [stream["name"] for stream in told["streams"]][:2] == ["joints", "left_forearm"]
    assert "100 frames/s of 100" in tci("doctor", "nao", "--via", "sim", "--duration", "0.5")


def test_a_robot_that_can_not_be_reached_is_a_fault() -> None:
    text = tci("doctor", "nao", "--via", "replay:/no/such/file.mcap", status=1)
    assert "No such file" in text
    assert "1 fault" in text
    assert "needs the robot's name" in tci("doctor", "--via", "sim", status=1)
    assert "valid: " in tci("doctor", "nao", "--via", "smoke", status=1)


def test_the_first_minutes_with_a_simulated_robot() -> None:
    told = json.loads(tci("check", "nao", "--hardware", "--only", "left_arm", "--taxels", "2", "--json"))
    assert told["sound"]
    assert 1.7 < told["largest_motion_deg"] <= 2.0
    assert {"left_arm", "LElbowRoll", "left_forearm taxel 239"} <= {f["subject"] for f in told["findings"]}
    assert "valid: " in tci("check", "nao", "--hardware", "--only", "left_wing", status=1)


@pytest.mark.timeout(300)
def test_at_a_keyboard_nothing_moves_without_a_yes_and_nobody_there_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    needs_qi()
    one = Served("nao", "naoqi:127.0.0.1:0")
    words = ["check", "nao", "--hardware", "--only", "Head", "--via", f"naoqi://127.0.0.1:{one.port}"]

    def said(answers: str, *options: str, status: int) -> str:
        monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
        return tci(*words, *options, status=status)

    try:
        kept = " ".join(said("?\nn\nn\n", status=0).split())
        assert "not moved: the operator did not permit it" in kept
        assert "went" not in kept
        denied = " ".join(said("n\n", status=1).split())
        assert "does not agree with its encoders" in denied
        assert "went" not in denied
        assert json.loads(said("?\nn\nn\n", "--json", status=0))["robot"] == "nao"
        command = [sys.executable, "-m", "tci.cli.main", *words]
        run = subprocess.run(command, input="", capture_output=True, text=True, check=False)
        assert "a question had no answer" in " ".join((run.stdout + run.stderr).split())
        assert "went" not in run.stdout
    finally:
        one.kill()
