"""What a person types wrongly is answered with what to type, and lists are short enough to read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.command_line import tci
from tci.cli.console import console
from tci.cli.main import app
from tci.cli.robots import robots

MODULE = """
import tci

class Wrong(tci.Capability):
    def init(self, body):
        return None

    def step(self, perception):
        return ()

class Mended(Wrong):
    def step(self, memory, perception, body):
        return (), memory
"""


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (("run", "nao", "withdrawal"), "withdrawal is a capability, no robot; valid: tci run withdrawal"),
        (("demo", "withdrawal"), "valid: tci run withdrawal ROBOT, with ROBOT one of alex, allegro, franka"),
        (("run", "nao", "mine:Shrug"), "valid: tci run mine:Shrug ROBOT"),
        (("run", "withdrawal", "a/b.urdf"), "a/b.urdf is a model, no description of a robot"),
        (("describe", "B.MJCF"), "valid: the description that tci new-robot B.MJCF writes"),
        (("run", "withdrawal", "nao", "--via", "10.0.0.5"), "naoqi://10.0.0.5, yarp:10.0.0.5"),
        (("run", "withdrawal", "nao", "--via", "nao.local:9559"), "naoqi://nao.local"),
        (("run", "withdrawal", "nao", "--record", "x.csv"), "valid: a name that ends in .mcap"),
        (("record", "x.bag", "nao", "--duration", "0.1"), "valid: a name that ends in .mcap"),
    ],
)  # fmt: skip
def test_a_mistake_is_answered_with_what_to_type(
    words: tuple[str, ...], answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert answer in tci(*words, status=1)
    assert not [*tmp_path.iterdir()]


def test_the_root_of_a_model_is_named(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text('<robot name="x"/>')
    assert "it is a model: tci new-robot writes its description" in tci("describe", str(file), status=1)


def test_a_wrong_class_leaves_the_others_of_its_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "two_of_mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    assert "nothing moved" in tci("run", "two_of_mine:Mended", "nao", "--duration", "0.02")
    told = tci("run", "two_of_mine:Wrong", "nao", "--duration", "0.02", status=1)
    assert "Wrong.step(self, perception) has other arguments than a capability; valid: def step(self" in told
    assert "valid: Mended" in tci("run", "two_of_mine:Other", "nao", status=1)


def test_every_command_has_one_line_in_the_help() -> None:
    command = [sys.executable, "-m", "tci.cli.main", "--help"]
    told = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "110"}
    ).stdout
    listed = told[told.index("Commands") :].splitlines()[1:]
    rows = [line for line in listed if line.startswith("│")]
    assert len(rows) == len(app.registered_commands) + len(app.registered_groups)


def test_the_list_of_robots_is_short(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "width", 80)
    robots()
    said = capsys.readouterr().out
    assert said.count("rosbridge") == 1
    assert "--via naoqi: nao, nao-h21" in said
    assert "13 switches" in said
    assert len(said.splitlines()) < 40
