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

    The film shows the posture of the robot, the pressure on its skin, and the hand or finger that touched a
    simulated robot. What touched a real one is not known, so it is not drawn. The film has 50 pictures for a
    second of the recording, and each takes 1 to 3 s.

    Example:  tci film touch.mcap touch.gif --from 0.2 --to 0.9
    """
    from tci.lab.pictures.film import film as film_recording
    from tci.recording.recording import Recording

    pictures = film_recording(file, out, robot=robot, part=part, begin=begin, end=end)
    written(out, {"pictures": pictures}, as_json=as_json)
    if not as_json and next(Recording(file).touching(), None) is None:
        words = "this recording does not know what touched the robot, so it is not drawn"
        console.print(words, style="dim", highlight=False, markup=False)
