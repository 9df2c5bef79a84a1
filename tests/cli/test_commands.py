"""What all commands have in common."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from tci.cli.main import app
from tci.cli.run import load_capability

SILENT = {"view", "zenoh router"}
"""They run until they are interrupted, and report nothing."""


OWN = """
import tci

class Shrug(tci.Capability):
    def init(self):
        return 7

    def step(self, memory, perception):
        return (), memory
"""


def commands(command: object, before: str = "") -> dict[str, object]:
    """Every command that does something, by what a user types."""
    inner = getattr(command, "commands", None)
    if inner is None:
        return {before: command}
    found: dict[str, object] = {}
    for name, one in inner.items():
        found |= commands(one, f"{before} {name}".strip())
    return found


COMMANDS = commands(typer.main.get_command(app))


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_reports_come_as_json_too(name: str) -> None:
    options = {option for one in COMMANDS[name].params for option in one.opts}
    assert ("--json" in options) is (name not in SILENT)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_shows_every_unit(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "400"}).output
    words = " ".join(one.help.replace("\\[", "[") for one in COMMANDS[name].params if one.help)
    for unit in re.findall(r"\[(?:m|s|N|Hz|rad)\]", words):
        assert unit in shown


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["demo", "--fault", "stall@0.3", "--via", "zenoh"], "valid beside it: --robot, --json"),
        (["demo", "--via", "sim"], "no server named 'sim'; valid: lcm"),
        (["demo", "--robot", "icub", "--via", "naoqi"], "no binding of icub named 'naoqi'"),
        (["run", "withdrawal", "--robot", "nao", "--duration", "-1"], "valid: above 0 s"),
        (["run", "withdrawal", "--robot", "nao", "--duration", "nan"], "valid: above 0 s"),
        (["run", "withdrawal", "--robot", "nao", "--film", "none/shrug.gif"], "none is no folder"),
        (["run", "nowhere:Shrug", "--robot", "nao"], "valid: MODULE:CLASS"),
        (["run", "math:pi", "--robot", "nao"], "valid: a subclass of tci.Capability"),
        (["view", "--port", "99999"], "less than or equal to 65535"),
        (["describe", "nao.txt"], "or the path of a description (.xml)"),
        (["check", "nao", "--only", "left_arm"], "valid: with --hardware"),
        (["check", "nao", "--hardware", "--taxels", "-5"], "greater than or equal to -1"),
        (["new-robot", "none.urdf"], "no such file"),
        (["skin", "locate", "nao", "--patch", "left_forearm", "--wrong", "-5"], "greater than or equal to 0"),
        (["gesture", "record", "none/wave.csv", "--robot", "nao"], "a .csv file in a folder that is there"),
        (["gesture", "convert", "none.bvh", "wave.txt"], "a .csv file in a folder that is there"),
        (["zenoh", "router", "none.json5"], "does not exist"),
    ],
    ids=" ".join,
)
def test_what_is_wrong_is_said_at_once_with_what_would_be_valid(
    words: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, words, env={"COLUMNS": "400"})
    assert told in result.output + str(result.exception)
    assert not list(tmp_path.iterdir())


def test_a_capability_runs_from_a_file_beside_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shrugging.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert load_capability("shrugging:Shrug").init() == 7
