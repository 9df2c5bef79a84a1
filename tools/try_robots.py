"""Tries `tci new-robot` and `tci check` on model files, and prints a table of what came out.

Run:  python tools/try_robots.py FILE... [--without-meshes]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tci.authoring.proposal import propose
from tci.commissioning.plausibility import doubts
from tci.errors import TciError
from tci.robot.description import Robot

HEAD = ("robot", "model", "arm joints", "hands", "head", "torso", "leg joints", "doubts", "or why refused")


def row(path: Path, *, meshes: str | None) -> tuple[str, ...]:
    """Returns the row of one file."""
    start = path.stem, path.suffix.lower().lstrip(".")
    try:
        robot = propose(path, name="tried", meshes=meshes)
    except TciError as error:
        faults = getattr(error, "faults", (error,))
        return (
            *start,
            *[""] * 6,
            f"{faults[0]}" + (f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""),
        )
    robot = robot.model_copy(update={"digest": str(path)})
    kinds = [_mapped(robot, kind) for kind in ("arm", "hand", "head", "torso", "leg")]
    return *start, *kinds, str(len(doubts(robot))), ""


def _mapped(robot: Robot, kind: str) -> str:
    """Returns the number of joints of each part of a kind that the robot has."""
    counts = [sum(one.servo is not None for one in part.servos) for part in robot.parts if part.kind == kind]
    return " + ".join(str(count) for count in counts) or "0"


def main() -> None:
    """Prints the table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--without-meshes", action="store_true")
    options = parser.parse_args()
    meshes = "none" if options.without_meshes else None
    print(f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}", sep="\n")
    for path in options.files:
        print(f"| {' | '.join(row(path, meshes=meshes))} |")


if __name__ == "__main__":
    main()
