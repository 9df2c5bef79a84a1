"""`tci robots`."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from tci.cli.console import console, print_json
from tci.errors import MissingExtraError
from tci.robot.catalogue import load_robot, robot_names


def robots(*, as_json: bool) -> None:
    """List every known robot, also those whose model is not installed."""
    rows = [_row(name) for name in robot_names()]
    if as_json:
        print_json({"robots": rows})
        return
    table = Table(
        "robot", "what", "generic parts", "servos", "skin", "drivers", title="Robots", box=box.SIMPLE_HEAD
    )
    for row in rows:
        if "missing" in row:
            table.add_row(f"[bold]{row['name']}[/]", Text(row["missing"], "yellow"))
        else:
            table.add_row(
                f"[bold]{row['name']}[/]",
                row["title"],
                ", ".join(row["parts"]),
                str(row["servos"]),
                f"{len(row['skin'])} patches, {sum(row['skin'].values())} channels",
                ", ".join(row["drivers"]),
            )
    console.print(table)
    console.print("Look at one with [bold]tci describe NAME[/]; add your own: docs/robot-description.md")


def _row(name: str) -> dict[str, Any]:
    try:
        robot = load_robot(name)
    except MissingExtraError as error:
        return {"name": name, "missing": str(error)}
    return {
        "name": name,
        "title": robot.title,
        "parts": [part.name for part in robot.parts],
        "servos": len(robot.servos),
        "skin": {patch.name: patch.channels for patch in robot.patches},
        "drivers": [binding.middleware for binding in robot.bindings],
    }
