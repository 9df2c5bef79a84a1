"""Arguments and options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion
from tci.errors import CommandError, UnknownNameError


def _above_zero(seconds: float | None) -> float | None:
    """Raises BadParameter if a duration [s] is not a finite number above 0."""
    if seconds is None or 0.0 < seconds < math.inf:
        return seconds
    raise typer.BadParameter(f"{seconds} s; valid: above 0 s and finite")


def _known_robots(given: str | list[str] | None) -> str | list[str] | None:
    """Raises UnknownNameError if a given robot has no description, and CommandError if it is a capability.
    Called before the command loads other modules, so that the error comes at once."""
    from tci.robot.catalogue import check_name

    for name in [given] if isinstance(given, str) else given or ():
        try:
            check_name(name)
        except UnknownNameError as error:
            if name in completion.capabilities("") or (":" in name and "/" not in name):
                raise CommandError(
                    f"{name} is a capability, no robot; valid: tci run {name} ROBOT, with ROBOT one of "
                    f"{', '.join(error.valid)}"
                ) from None
            raise
    return given


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
_robot = typer.Argument(
    help="Robot: a name from tci robots, or a description file.",
    autocompletion=completion.robots,
    callback=_known_robots,
)
RobotName = Annotated[str, _robot]
OptionalRobot = Annotated[str | None, _robot]
SomeRobots = Annotated[
    list[str] | None,
    typer.Argument(
        help="Robots: names from tci robots, or description files. "
        "\\[default: nao and icub, the robots of the paper, if installed]",
        autocompletion=completion.robots,
        callback=_known_robots,
    ),
]
RecordedRobot = Annotated[
    str | None,
    typer.Argument(
        help="Recorded robot: a name or a description file. \\[default: the robot's name in the recording]",
        autocompletion=completion.robots,
    ),
]
_via = typer.Option(
    help="Driver that connects to the robot, NAME or NAME:ADDRESS.", autocompletion=completion.drivers
)
Via = Annotated[str, _via]
OptionalVia = Annotated[str | None, _via]
Arm = Annotated[
    bool, typer.Option("--arm", help="Allow a real robot to move. Simulated robots need no permission.")
]
Duration = Annotated[
    float | None, typer.Option(help="Duration \\[s]. \\[default: until Ctrl-C]", callback=_above_zero)
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        help="Fault to inject: NAME@TIME or NAME@TIME:DURATION \\[s]; repeat for several; names: "
        "tci fault list."
    ),
]
Touches = Annotated[
    list[str] | None,
    typer.Option(
        "--touch",
        help="A person touches a simulated robot: KIND PLACE, and if known force, speed, duration and onset, "
        "e.g. \"stroke 'left forearm' 0.2..0.8 3N 8cm/s 2s @0.5s\"; repeat for several. Kinds and places: "
        "tci touches ROBOT.",
    ),
]
TouchFile = Annotated[
    Path | None,
    typer.Option(
        "--touches",
        help="A file with a sequence of touches: BIDS events (.tsv), ELAN (.eaf, .txt) or BORIS (.csv).",
    ),
]
RecordingFile = Annotated[Path, typer.Argument(help="Recording (.mcap).")]
Task = Annotated[
    str | None,
    typer.Option(help="What the recording shows, for data sets: the text of its episode's task."),
]
NewRecording = Annotated[Path, typer.Argument(help="Recording to write (.mcap), a new file.")]
NewGesture = Annotated[Path, typer.Argument(help="Gesture to write (.csv), a new file.")]
Begin = Annotated[
    float, typer.Option("--from", help="Start of the time span \\[s], on the clock of the recording.")
]
End = Annotated[
    float, typer.Option("--to", help="End of the time span \\[s], on the clock of the recording.")
]
