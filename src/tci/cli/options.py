"""Arguments and options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion


def _above_zero(seconds: float | None) -> float | None:
    """A time that can pass."""
    if seconds is None or 0.0 < seconds < math.inf:
        return seconds
    raise typer.BadParameter(f"{seconds} s; valid: above 0 s")


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of words.")]
_robot = typer.Argument(help="Robot by name, or a description file.", autocompletion=completion.robots)
RobotName = Annotated[str, _robot]
OptionalRobot = Annotated[str | None, _robot]
SomeRobots = Annotated[
    list[str] | None,
    typer.Argument(
        help="Robots by name, or description files. "
        "\\[default: the paper's two, nao and icub, where installed]",
        autocompletion=completion.robots,
    ),
]
RecordedRobot = Annotated[
    str | None,
    typer.Argument(
        help="Robot that was recorded, by name or description file, where the recording's own words will not "
        "do.",
        autocompletion=completion.robots,
    ),
]
_via = typer.Option(help="Driver that reaches it, NAME or NAME:ADDRESS.", autocompletion=completion.drivers)
Via = Annotated[str, _via]
OptionalVia = Annotated[str | None, _via]
Arm = Annotated[bool, typer.Option("--arm", help="Let it move; a simulated robot always may.")]
Duration = Annotated[
    float | None, typer.Option(help="How long \\[s]; else until interrupted.", callback=_above_zero)
]
Faults = Annotated[
    list[str] | None,
    typer.Option(help="NAME@TIME or NAME@TIME:DURATION \\[s]; names: tci fault list; repeat for several."),
]
RecordingFile = Annotated[Path, typer.Argument(help="Recording (.mcap).")]
NewRecording = Annotated[Path, typer.Argument(help="The recording to write.")]
NewGesture = Annotated[Path, typer.Argument(help="The gesture to write (.csv).")]
Begin = Annotated[float, typer.Option("--from", help="Begin \\[s] on its clock.")]
End = Annotated[float, typer.Option("--to", help="End \\[s].")]
