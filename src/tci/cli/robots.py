"""`tci robots`: lists the robots that have a description."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.text import Text

from tci.cli.console import console, print_json
from tci.cli.options import AsJson
from tci.errors import MissingExtraError

if TYPE_CHECKING:
    from tci.robot.description import Robot

PAPER = ("icub", "nao")
"""Names of the two robots in the paper's experiments (Ma and Dahl, 2016)."""


def robots(as_json: AsJson = False) -> None:
    """List the robots that have a description."""
    from rich.table import Table

    from tci.robot.catalogue import robot_names
    from tci.robot.description.binding import USUAL

    found = {name: _load(name) for name in robot_names()}
    rows = [_row(name, robot) for name, robot in found.items()]
    if as_json:
        print_json({"robots": rows})
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for heading in ("name", "robot", "servos", "skin"):
        table.add_column(heading, overflow="fold", no_wrap=heading == "name")
    for row in rows:
        if "missing" in row:
            table.add_row(f"[bold]{row['name']}[/]", Text("not installed", "yellow"))
        else:
            table.add_row(
                f"[bold]{row['name']}[/]",
                Text(row["title"]),
                str(row["servos"]),
                _skin(row),
            )
    console.print(table)
    own: dict[str, list[str]] = {}
    for row in rows:
        for wire in row.get("drivers", ()):
            if wire not in USUAL:
                own.setdefault(wire, []).append(row["name"])
    console.print(f"--via, all: {', '.join(USUAL)}", highlight=False)
    for wire, names in own.items():
        console.print(f"--via {wire}: {', '.join(names)}", highlight=False)
    missing: dict[tuple[str, str], list[str]] = {}
    for name, robot in found.items():
        if isinstance(robot, MissingExtraError):
            missing.setdefault((robot.missing, robot.advice), []).append(name)
    for (package, advice), names in missing.items():
        words = f"not installed: {package}, for {', '.join(names)}; {advice}"
        console.print(words, style="yellow", highlight=False, markup=False, soft_wrap=True)
    console.print("show one: [bold]tci describe NAME[/]; add your own: tci new-robot (docs/add-a-robot.md)")


def _load(name: str) -> Robot | MissingExtraError:
    """Returns the robot `name`, or the error if the robot's model is not installed."""
    from tci.robot.catalogue import load_robot

    try:
        return load_robot(name)
    except MissingExtraError as error:
        return error


def _row(name: str, robot: Robot | MissingExtraError) -> dict[str, Any]:
    if isinstance(robot, MissingExtraError):
        return {"name": name, "missing": str(robot)}
    return {
        "name": name,
        "title": robot.title,
        "parts": [part.name for part in robot.parts],
        "servos": len(robot.servos),
        "skin": {patch.name: patch.channels for patch in robot.skin},
        "switches": {patch.name: patch.channels for patch in robot.skin if patch.name in robot.switches},
        "through_joints": [patch.name for patch in robot.patches if patch.through_joints],
        "drivers": [binding.middleware for binding in robot.all_bindings],
    }


def _skin(row: dict[str, Any]) -> str:
    said = []
    if row["skin"]:
        switches = f", {sum(row['switches'].values())} switches" if row["switches"] else ""
        taxels = sum(count for name, count in row["skin"].items() if name not in row["switches"])
        said.append(f"{taxels} taxels{switches}" if taxels else switches.removeprefix(", "))
    if row["through_joints"]:
        said.append("by joint torques")
    return "; ".join(said) or "none"


def load_robots(names: Sequence[str]) -> list[Robot]:
    """Loads the robots with the given names. Without names, loads each of the paper's two robots that is
    installed."""
    from tci.robot.catalogue import load_robot

    if names:
        return [load_robot(name) for name in names]
    robots = []
    for name in PAPER:
        try:
            robots.append(load_robot(name))
        except MissingExtraError as error:
            typer.secho(f"{name} is left out: {error}", fg="yellow", err=True)
    return robots
