"""`tci plot`: draws a figure of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, Begin, End, RecordedRobot, RecordingFile
from tci.errors import RecordingError


def plot(
    file: RecordingFile,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write: png, pdf or svg. \\[default: a file in the folder of the recording]"
        ),
    ] = None,
    robot: RecordedRobot = None,
    part: Annotated[
        str | None,
        typer.Option(
            help="Generic part to draw. \\[default: the part that was touched first, and the parts that "
            "respond]"
        ),
    ] = None,
    begin: Begin = float("-inf"),
    end: End = float("inf"),
    as_json: AsJson = False,
) -> None:
    """Draw a recording as a figure for a paper. The figure shows forces, the response, joint angles, the
    unrolled skin and latencies.

    Example:  tci plot touch.mcap --out touch.pdf
    """
    from rich.progress import Progress

    from tci.capabilities.fields import default_fields
    from tci.lab.pictures.plot import collect, draw
    from tci.recording.perceived import perceive, recorded_robot
    from tci.recording.recording import Recording

    recording = Recording(file)
    found = recorded_robot(recording, robot)
    if found is None:
        raise RecordingError(
            f"{file} does not name its robot; valid: tci plot {file} ROBOT; its raw frames: tci log export"
        )
    out = out or file.with_suffix(".png")
    with Progress(console=console, transient=True, disable=as_json or not console.is_terminal) as progress:
        task = progress.add_task("computing contacts from the recorded frames", total=None)
        periods = []
        for period in perceive(recording, found):
            periods.append(period)
            progress.advance(task)
        parts, series = collect(found, periods, begin=begin, end=end, part=part)
        progress.update(task, description="drawing")
        behaviour = recording.about.get("capability") or "behaviour not recorded"
        title = f"{found.title or found.name}, {behaviour}, {file.name}"
        draw(found, series, out, fields=default_fields(), title=title)
    touches = [touch.to_json() for touch in series.touches]
    if as_json:
        facts = {"file": str(out), "part": parts[0], "parts": parts, "periods": len(series.time)}
        print_json({**facts, "touches": touches})
        return
    for touch in series.touches:
        after = touch.to_json()
        numbers = ", ".join(
            f"{word} {after[key]:.0f} ms" if after[key] is not None else f"no {word}"
            for word, key in (("command", "command_ms"), ("motion", "motion_ms"))
        )
        other = "" if touch.responding == touch.part else f" ({touch.responding})"
        length = 1e3 * (touch.ended - touch.began)
        lost = f"contact to the end ({length:.0f} ms)" if touch.lasts else f"lost {length:.0f} ms"
        felt = "pressed" if touch.patch in found.switches else f"{touch.peak_force:.1f} N"
        console.print(
            f"{touch.began:8.3f} s  {touch.patch}: {felt}, {numbers}{other}, {lost}",
            highlight=False,
            soft_wrap=True,
        )
    console.print(f"figure {out}", highlight=False, markup=False)
