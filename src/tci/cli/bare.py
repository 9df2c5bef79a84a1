"""Tells which parts of a robot have no skin, and what a capability lacks on it."""

from __future__ import annotations

from collections.abc import Sequence

from tci.body.touchable import without_skin
from tci.cli.console import console
from tci.robot.description import Robot
from tci.runtime.arguments import capabilities_for


def tell_bare(robot: Robot) -> None:
    """Prints the parts that feel nothing."""
    if bare := without_skin(robot):
        words = f"{robot.name} has no skin on {', '.join(bare)}: no touch is felt there"
        console.print(words, style="dim", highlight=False, markup=False)


def tell_lacks(name: str, missing: Sequence[str], robot: Robot) -> None:
    """Prints what `robot` lacks for the capability `name`, and what to do."""
    others = ", ".join(capabilities_for(robot)) or "none"
    words = (
        f"{name}: {'; '.join(missing)}\n  it runs and may move nothing; capabilities for {robot.name}: "
        f"{others}; robots with more skin: tci robots; skin for your own: docs/add-a-skin.md"
    )
    console.print(words, style="yellow", highlight=False, markup=False)
