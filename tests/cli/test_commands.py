"""What all commands have in common."""

from __future__ import annotations

import re

import pytest
import typer
from typer.testing import CliRunner

from tci.cli.main import app

SILENT = {"view", "zenoh router"}
"""They run until they are interrupted, and report nothing."""


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


def test_demo_refuses_what_a_rehearsal_has_no_use_for() -> None:
    told = CliRunner().invoke(app, ["demo", "--fault", "stall@0.3", "--via", "zenoh"])
    assert "valid beside it: --robot, --json" in str(told.exception)
