"""`tci log`: shows, cuts, exports and imports recordings."""

from __future__ import annotations

import re
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tci.cli.log_import import import_
from tci.cli.options import AsJson, Begin, End, NewRecording, RecordedRobot, RecordingFile

if TYPE_CHECKING:
    from tci.datasets.episodes import Pictures

SETS = ("lerobot", "oxt")
"""Formats of data sets, in which each recording is an episode."""

app = typer.Typer(help="Show, cut, export and import recordings.", no_args_is_help=True)
app.command("import")(import_)


@app.command()
def info(
    file: RecordingFile,
    quick: Annotated[
        bool, typer.Option("--quick", help="From the index alone: does not check that all can be read.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show the contents of a recording, and whether all of it can be read or its end is missing. With --quick
    at once, however long it is.

    Example:  tci log info touch.mcap
    """
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from tci.cli.console import console, print_json
    from tci.recording.index import indexed
    from tci.recording.recording import Recording

    recording = Recording(file)
    topics = indexed(file) if quick else recording.topics()
    periods = topics.get("/tci/tick")
    about: dict[str, Any] = {key: text for key, text in recording.about.items() if key != "description"}
    whole: dict[str, Any] = {
        "file": str(file),
        "bytes": file.stat().st_size,
        "complete": quick or recording.complete,
        "checked": not quick,
        "lost": [asdict(one) for one in recording.lost],
        "periods": periods.messages if periods else 0,
        "from_s": periods.first if periods else None,
        "to_s": periods.last if periods else None,
        "topics": {name: topic.messages for name, topic in topics.items()},
        "about": about,
    }
    if as_json:
        print_json(whole)
        return
    state = "[green]complete[/]" if recording.complete else "[yellow]cut off; readable up to there[/]"
    if quick:
        state = "complete; what its index says, without --quick all is read"
    span = f"{periods.first:.3f} to {periods.last:.3f} s" if periods else "empty"
    head = f"[bold]{escape(file.name)}[/]  {whole['bytes'] / 1e6:.2f} MB, {whole['periods']} periods"
    console.print(f"{head}, {span}, {state}", highlight=False)
    for lost in recording.lost:
        console.print(f"  {lost}; the rest is read", style="yellow", highlight=False, markup=False)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("topic")
    table.add_column("messages", justify="right")
    for topic, count in sorted(whole["topics"].items()):
        table.add_row(escape(topic), str(count))
    console.print(table)
    for key, text in about.items():
        if key == "settings" and not as_json and "(" in text:
            text = f"of {text.partition('(')[0]}; all values: tci log info {file} --json"
        console.print(f"  {key:<20} {text[:200]}", highlight=False, markup=False)


@app.command()
def cut(
    file: RecordingFile,
    out: NewRecording,
    begin: Begin = float("-inf"),
    end: End = float("inf"),
    as_json: AsJson = False,
) -> None:
    """Copy a time span of a recording to a new, compressed file. Without --from and --to, repair a recording
    whose end is missing.

    Example:  tci log cut touch.mcap poke.mcap --from 0.2 --to 0.9
    """
    from tci.cli.console import written
    from tci.errors import RecordingError
    from tci.recording.cut import cut as command
    from tci.recording.recording import Recording

    if out.exists():
        raise RecordingError(f"{out} exists and is not replaced; valid: a new file name")
    if not begin < end:
        raise RecordingError(f"--from {begin} s --to {end} s; valid: --to later than --from")
    recording = Recording(file)
    first, last = recording.span()
    if begin > last or end <= first:
        raise RecordingError(
            f"{file} has nothing from {begin} to {end} s; valid: within {first:.3f} to {last:.3f} s"
        )
    command(file, out, begin=begin, end=end, about={"cut_from": file.name})
    written(out, {}, as_json=as_json)


@app.command()
def export(
    file: Annotated[
        Path, typer.Argument(help="Recording (.mcap). For a data set also a folder of recordings.")
    ],
    out: Annotated[
        Path, typer.Argument(help="Folder for the tables or the set. With npz: file for the tables.")
    ],
    robot: RecordedRobot = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            "-f",
            help="csv, npz, parquet; data sets: lerobot, oxt. \\[default: npz if OUT ends in .npz, else csv]",
        ),
    ] = None,
    task: Annotated[
        str, typer.Option(help="For a data set: what the robot does, in words, as policies are told.")
    ] = "",
    fps: Annotated[int, typer.Option(help="For a data set: rows per second; skin keeps its own rate.")] = 30,
    columns: Annotated[
        str,
        typer.Option(
            help="For a set of LeRobot: only these columns, separated by commas. Its loader reads all of a "
            "set, used or not, dozens of milliseconds for each row."
        ),
    ] = "",
    picture: Annotated[
        str,
        typer.Option(
            help="For a data set: size, such as 320x240, of pictures of what the head saw, drawn from the "
            "recorded angles and touches."
        ),
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Write a recording as tables of joint data, gate decisions, contacts and skin frames, or as a data set
    of LeRobot (v3) or Open-X-Tactile (oxt, Zarr 2), in which each recording is an episode.

    The table of a patch has one row for each skin frame. A row contains the received raw values, and the
    pressures \\[Pa] and forces \\[N] of all taxels.

    Example:  tci log export touch.mcap tables --format csv

    Example:  tci log export recordings/ touch-set --format lerobot --task "give way to the touch"
    """
    from tci.errors import RecordingError

    if form in SETS:
        if columns and form != "lerobot":
            raise RecordingError(f"--columns for {form}; valid: for --format lerobot")
        names = [one.strip() for one in columns.split(",") if one.strip()]
        _export_set(
            form, file, out, robot, task=task, fps=fps, columns=names, picture=picture, as_json=as_json
        )
        return
    from tci.cli.console import console, print_json
    from tci.errors import TciError
    from tci.recording.export import export as command
    from tci.recording.perceived import recorded_robot
    from tci.recording.recording import Recording

    recording, left_out = Recording(file), ""
    try:
        found = recorded_robot(recording, robot)
        left_out = "" if found else "the recording does not name its robot; give it as ROBOT"
    except TciError as error:
        if robot is not None:
            raise
        found, left_out = None, str(error)
    files = command(recording, out, form or ("npz" if out.suffix == ".npz" else "csv"), found)
    if as_json:
        print_json({"files": [str(path) for path in files], "left_out": left_out})
        return
    if left_out:
        typer.secho(f"raw values only, without forces: {left_out}", fg="yellow", err=True)
    for path in files:
        console.print(str(path), highlight=False, markup=False)


def _pictures(size: str) -> Pictures | None:
    from tci.datasets.episodes import Pictures
    from tci.errors import RecordingError
    from tci.lab.pictures.recorded_head import recorded_head

    if not size:
        return None
    found = re.fullmatch(r"(\d{1,4})x(\d{1,4})", size)
    if found is None:
        raise RecordingError(f"--picture {size}; valid: WIDTHxHEIGHT in pixels, such as 320x240")
    width, height = map(int, found.groups())
    return Pictures(width, height, partial(recorded_head, width=width, height=height))


def _export_set(
    form: str,
    file: Path,
    out: Path,
    robot: str | None,
    *,
    task: str,
    fps: int,
    columns: list[str],
    picture: str,
    as_json: bool,
) -> None:
    from tci.cli.console import console, print_json
    from tci.datasets.episodes import read_set
    from tci.errors import RecordingError

    files = sorted(file.glob("*.mcap")) if file.is_dir() else [file]
    if not files:
        raise RecordingError(f"{file} has no recording; valid: a folder of .mcap files")
    data = read_set(files, task=task, fps=fps, robot=robot, pictures=_pictures(picture))
    left_out = data.left_out
    if form == "lerobot":
        from tci.datasets.lerobot import write_lerobot

        write_lerobot(data, out, columns=columns)
    else:
        from tci.datasets.open_x_tactile import write_oxt

        left_out = write_oxt(data, out)
    frames = sum(episode.frames for episode in data.episodes)
    if as_json:
        print_json(
            {
                "set": str(out), "episodes": len(data.episodes), "frames": frames, "fps": data.fps,
                "tasks": sorted({episode.task for episode in data.episodes}),
                "left_out": list(left_out),
            }
        )  # fmt: skip
        return
    words = f"{out}: {len(data.episodes)} episodes, {frames} frames at {data.fps} per second"
    console.print(words, highlight=False, markup=False)
    for one in left_out:
        console.print(f"  left out: {one}", style="yellow", highlight=False, markup=False)


@app.command()
def touches(
    file: RecordingFile,
    out: Annotated[Path, typer.Argument(help="Sequence of touches to write (.tsv), a new file.")],
    robot: RecordedRobot = None,
    as_json: AsJson = False,
) -> None:
    """Write the touches in a recording as a BIDS events file, which tci run --touches does again on any
    robot. The kind of each touch is a guess from its way, length and force.

    Example:  tci log touches touch.mcap touches.tsv
    """
    from tci.body.generic_body import GenericBody
    from tci.cli.console import written
    from tci.errors import RecordingError
    from tci.recording.perceived import perceive, recorded_robot
    from tci.recording.recording import Recording
    from tci.touches.events import write_touches
    from tci.touches.observed import observe

    if out.exists():
        raise RecordingError(f"{out} exists and is not replaced; valid: a new file name")
    recording = Recording(file)
    found = recorded_robot(recording, robot)
    if found is None:
        raise RecordingError(f"{file} does not name its robot; valid: give it as ROBOT")
    felt = observe((period.perception for period in perceive(recording, found)), GenericBody(found))
    write_touches(out, felt)
    written(out, {"touches": len(felt)}, as_json=as_json)
