"""Properties of every command: JSON, order of arguments, help, errors."""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from helpers.command_line import tci
from helpers.recorded import LIKE_LISTING_2
from tci import GenericBody, cli, load_robot
from tci.cli.check import check
from tci.cli.guide import FIRST, NEXT
from tci.cli.main import app
from tci.cli.robots import load_robots, robots
from tci.errors import MissingExtraError
from tci.robot.description import Robot
from tci.runtime.arguments import load_capability

SILENT = {"view", "zenoh router"}
"""Commands that run until an interrupt and print no report."""


OWN = """
import tci


class Shrug(tci.Capability):
    def init(self, body):
        return 7

    def step(self, memory, perception, body):
        return (), memory
"""


def commands(command: object, before: str = "") -> dict[str, object]:
    """Yields every command that can be run, as the words that a user types."""
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
def test_help_ends_with_the_next_command_to_try(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "400"}).output
    last = [line.strip() for line in shown.splitlines() if line.strip()][-1]
    assert last == f"Next:  {NEXT[name]}"
    assert NEXT[name] != f"tci {name}"


@pytest.mark.parametrize("line", sorted({*NEXT.values(), *(command for command, _ in FIRST)}))
def test_the_commands_to_try_exist_with_their_options(line: str) -> None:
    tci, *words = line.split()
    (name,) = [one for one in COMMANDS if words[: len(one.split())] == one.split()]
    known = {option for one in COMMANDS[name].params for option in one.opts}
    assert tci == "tci"
    assert known >= {word for word in words if word.startswith("--")}


def test_without_arguments_the_commands_to_try_first_are_listed() -> None:
    result = CliRunner().invoke(app, [])
    assert result.exit_code == 0
    for command, purpose in FIRST:
        assert re.search(rf"^  {command} +{purpose}$", result.output, re.MULTILINE)
    assert CliRunner().invoke(app, ["--version"]).output.startswith("tci ")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_the_robot_is_the_last_word_of_every_command(name: str) -> None:
    params = COMMANDS[name].params
    assert not [one.name for one in params if {"--robot", "-r"} & set(one.opts)]
    # what is said any number of times, as in `tci touch ROBOT WORDS...`, comes after it
    words = [one.name for one in params if one.param_type_name == "argument" and one.nargs != -1]
    assert "robot" not in words[:-1]


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_shows_every_unit_and_default(name: str) -> None:
    """The library Rich would read text in brackets as a colour and drop it, unless the brackets are
    escaped."""
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "400"}).output
    words = " ".join(one.help.replace("\\[", "[") for one in COMMANDS[name].params if one.help)
    for told in re.findall(r"\[[^\]]+\]", words):
        assert told in shown


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_the_terminal_breaks_the_lines_of_help(name: str) -> None:
    words = inspect.getdoc(COMMANDS[name].callback)
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "600"}).output
    for paragraph in words.replace("\\[", "[").split("\n\n"):
        assert paragraph.replace("\n", " ") in shown


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["demo", "--fault", "stall@0.3", "--via", "zenoh"], "valid with them: one ROBOT, --json"),
        (["demo", "--via", "sim"], "no server named 'sim'; valid: lcm"),
        (["demo", "icub", "--via", "naoqi"], "no binding of icub named 'naoqi'"),
        (["run", "withdrawal", "nao", "--duration", "-1"], "valid: above 0 s"),
        (["run", "withdrawal", "nao", "--duration", "nan"], "valid: above 0 s"),
        (["run", "withdrawal", "nao", "--film", "none/shrug.gif"], "none is no folder"),
        (["run", "nowhere:Shrug", "nao"], "valid: MODULE:CLASS"),
        (["run", "../../x:y", "nao"], "../../x:y: a path is no module; valid: MODULE:CLASS"),
        (["run", "math:pi", "nao"], "valid: a subclass of tci.Capability"),
        (["view", "--port", "99999"], "less than or equal to 65535"),
        (["describe", "nao.txt"], "or the path of a description (.xml)"),
        (["check", "nao", "--only", "left_arm"], "valid: add --hardware"),
        (["check", "nao", "--hardware", "--taxels", "-5"], "greater than or equal to -1"),
        (["new-robot", "none.urdf"], "no such file"),
        (["skin", "locate", "nao", "--patch", "left_forearm", "--wrong", "-5"], "greater than or equal to 0"),
        (["gesture", "record", "none/wave.csv", "nao"], "a .csv file in a folder that exists"),
        (["gesture", "convert", "none.bvh", "wave.txt"], "a .csv file in a folder that exists"),
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


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["describe", "na"], ["nao", "nao-h21", "nao-hands", "nao-plain", "nao-plain-h21", "nao-whole"]),
        (["view", "nao", "ica"], []),
        (["view", "nao", "icub-"], ["icub-hands", "icub-whole"]),
        (["run", "withdrawal", "icub-"], ["icub-hands", "icub-whole"]),
        (["skin", "show", "tal"], ["talos"]),
        (["run", "withd"], ["withdrawal"]),
        (["view", "--run", "soft"], ["soft-hands", "soft-reaction"]),
        (["run", "withdrawal", "nao", "--via", "ros"], ["ros1", "ros2", "rosbridge"]),
        (["serve", "nao", "--via", "z"], ["zenoh"]),
        (["serve", "nao", "--via", "si"], []),
    ],
    ids=" ".join,
)
def test_a_shell_completes_names(words: list[str], offered: list[str]) -> None:
    asked = {
        "_TCI_COMPLETE": "complete_bash",
        "COMP_CWORD": str(len(words)),
        "COMP_WORDS": " ".join(["tci", *words]),
    }
    result = CliRunner().invoke(app, [], prog_name="tci", env=asked)
    assert sorted(result.output.split()) == offered


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["record", "a.mcap", "nao", "--bogus"], "No such option: --bogus"),
        (["record", "a.mcap"], "Missing argument 'robot'"),
        (["demo", "--seed", "-1"], "greater than or equal to 0"),
        (["dance"], "No such command 'dance'"),
    ],
    ids=" ".join,
)
def test_wrong_words_are_told_as_json_too(words: list[str], told: str) -> None:
    assert told in json.loads(tci(*words, "--json", status=2))["error"]


def test_a_robot_that_is_not_installed_is_no_part_of_the_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(name: str) -> Robot:
        raise MissingExtraError(f"the robot {name!r}", name, "install it")

    monkeypatch.setattr("tci.robot.catalogue.load_robot", load)
    assert load_robots([]) == []
    told = capsys.readouterr()
    assert not told.out
    assert "icub is left out" in told.err


def test_the_advice_for_robots_that_are_not_installed_is_one_unbroken_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(name: str) -> Robot:
        raise MissingExtraError(f"the model of {name}", "models", f"pip install '{'x' * 80}[robots]'")

    monkeypatch.setattr("tci.robot.catalogue.load_robot", load)
    monkeypatch.setattr("tci.robot.catalogue.robot_names", lambda: ("g1", "icub"))
    monkeypatch.setattr("tci.cli.robots.console.width", 80)
    robots()
    told = capsys.readouterr().out
    assert told.count("pip install") == 1
    assert f"not installed: models, for g1, icub; pip install '{'x' * 80}[robots]'\n" in told
    robots(as_json=True)
    rows = json.loads(capsys.readouterr().out)["robots"]
    assert [row["missing"].count("pip install") for row in rows] == [1, 1]


def test_brackets_in_a_name_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "in [mm]"
    folder.mkdir()
    (folder / "two.xml").write_text(LIKE_LISTING_2)
    check(str(folder / "two.xml"), simulate=False, as_json=False)
    assert "/in [mm]/" in capsys.readouterr().out.replace("\n", "")


def test_a_capability_runs_from_a_file_beside_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shrugging.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert load_capability("shrugging:Shrug").init(GenericBody(load_robot("nao"))) == 7


def test_no_option_is_declared_twice() -> None:
    """Options that several commands share are declared once, in the module `options`."""
    declared: dict[str, list[str]] = {}
    for path in sorted(Path(cli.__file__).parent.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("typer.Option", "typer.Argument"):
                declared.setdefault(ast.unparse(node), []).append(f"{path.name}:{node.lineno}")
    assert len(declared) > 60
    assert not {words: places for words, places in declared.items() if len(places) > 1}
