"""`tci film`: films a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, written
from tci.cli.options import AsJson, Begin, End, RecordedRobot, RecordingFile


def film(
    file: RecordingFile,
    out: Annotated[
        Path,
        typer.Argument(help="Film to write, a new file: .gif, .webp, .png or .mp4 (needs the extra video)."),
    ],
    robot: RecordedRobot = None,
    part: Annotated[
        str | None, typer.Option(help="Generic part to film. \\[default: the part that was touched first]")
    ] = None,
    begin: Begin = float("-inf"),
    end: End = float("inf"),
    as_json: AsJson = False,
) -> None:
    """Film a recording in slow motion (3x).

    The film shows the posture of the robot and the pressure on its skin. What touched it is not in a
    recording, so it is not drawn.

    Example:  tci film touch.mcap touch.gif --from 0.2 --to 0.9
    """
    from tci.capabilities.fields import default_fields
    from tci.errors import RecordingError
    from tci.lab.pictures.film import EVERY, Film
    from tci.recording.perceived import perceive, recorded_robot
    from tci.recording.recording import Recording
    from tci.simulation.world import World

    recording = Recording(file)
    found = recorded_robot(recording, robot)
    if found is None:
        raise RecordingError(f"{file} does not name its robot; valid: tci film {file} OUT ROBOT")
    periods = [one for one in perceive(recording, found) if begin <= one.now <= end]
    if not periods:
        first, last = recording.span()
        raise RecordingError(
            f"{file} has nothing from {begin} to {end} s; valid: within {first:.3f} to {last:.3f} s"
        )
    touched = (contact.part for one in periods for contact in one.perception.contacts)
    shown = found.part(part or next(touched, found.parts[0].name)).name
    world = World(found)
    made = Film(world, out, fields=default_fields(), part=shown)
    if not as_json:
        count = round((periods[-1].now - periods[0].now) / EVERY)
        console.print(f"{count} pictures of {shown}, each in 1 to 3 s of drawing", style="dim")
    for one in periods:
        world.show(one.reading.joints.position)
        made.see(one)
    written(out, {"pictures": made.save()}, {"part": shown}, as_json=as_json)
