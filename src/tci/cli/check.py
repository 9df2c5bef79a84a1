"""`tci check`."""

from __future__ import annotations

from pathlib import Path

from tci.cli.console import console, print_json
from tci.model.description import Robot
from tci.model.xml import read_robot


def check(file: Path, *, as_json: bool) -> None:
    """Read a description. Raises DescriptionError with every fault; prints what to know otherwise."""
    robot = read_robot(file)
    notes = list(remarks(robot))
    if as_json:
        print_json({"robot": robot.name, "valid": True, "remarks": notes})
        return
    console.print(
        f"[green]{file} is valid[/]: {robot.name}, {len(robot.parts)} generic parts, "
        f"{len(robot.servos)} servos, {len(robot.patches)} patches of skin"
    )
    for note in notes:
        console.print(f"  note: {note}", style="yellow", highlight=False)


def remarks(robot: Robot) -> list[str]:
    """What is allowed but worth knowing: a servo without limits can't be moved, and so on."""
    needed = ("lower", "upper", "velocity", "acceleration", "jerk")
    notes = []
    for part in robot.parts:
        for generic in part.servos:
            if generic.servo is None:
                notes.append(f"{part.name}: the robot lacks {generic.name}; it reads as fixed")
                continue
            servo = robot.servos[generic.servo]
            missing = [name for name in needed if getattr(servo.limits, name) is None]
            if missing:
                notes.append(
                    f"{part.name} {generic.name}: {servo.name} has no limit of {', '.join(missing)}, "
                    "so the gate will refuse to move it"
                )
    if robot.model is None:
        notes.append("no kinematic model: no simulation, no skin in space")
    if not robot.bindings:
        notes.append("no binding: no link can reach it")
    return notes
