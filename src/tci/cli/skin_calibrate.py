"""`tci skin calibrate`: measures rest values, noise and response of a patch of skin. A person places weights
on the patch."""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.table import Table

from tci.cli.console import console, print_json
from tci.cli.options import RobotName, Via
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.lab.authoring.calibrate_force import ForceFit
    from tci.lab.authoring.load_skin import PatchMeasurement


def calibrate(
    robot: RobotName,
    patch: Annotated[str, typer.Option(help="Patch of skin to calibrate.")],
    via: Via = "sim",
    weight: Annotated[
        list[float] | None,
        typer.Option(help="Known load \\[N]. Repeat the option for several loads, the lightest first."),
    ] = None,
    force_log: Annotated[
        Path | None,
        typer.Option(
            help="Instead of weights: log of a force/torque sensor from the time of the recording, as CSV "
            "(time,force or time,fx,fy,fz) or from yarpdatadumper."
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=20, help="Number of skin frames to measure at rest.")] = 200,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Calibration to write. \\[default: a file in the folder of the robot's description]"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, and ask no questions.")] = False,
) -> None:
    """Measure the rest values and the noise of a patch, and the response of the patch to known loads, step by
    step. Without loads, TCI keeps the response in the description. In simulation, the simulated finger
    presses the patch. TCI stores the result in a file beside the description, and uses this file in all later
    runs.

    Example:  tci skin calibrate nao --patch left_forearm --weight 0.5 --weight 2 --out nao.skin.json

    Example:  tci skin calibrate icub --patch left_forearm --via replay:stand.mcap --force-log data.log
    """
    from rich.progress import Progress

    from tci.lab.authoring.load_skin import calibrate_patch
    from tci.robot.catalogue import load_robot

    def ask(words: str) -> None:
        if as_json:
            return
        if not sys.stdin.isatty():
            raise CommandError("no terminal to press Enter in; valid: a terminal, --json, or --force-log")
        bar.stop()  # the progress bar would cover the user's answer
        console.input(f"{words} [dim]Press Enter when ready.[/] ")
        bar.start()

    with Progress(console=console, transient=True, disable=as_json or not console.is_terminal) as bar:
        task = bar.add_task("")
        done = calibrate_patch(
            load_robot(robot), patch, via=via, weights=weight or [], force_log=force_log, frames=frames,
            out=out, ask=ask,
            progress=lambda what, seen, of: bar.update(task, description=what, completed=seen, total=of),
        )  # fmt: skip
    if as_json:
        report = {"file": str(done.file), "patch": patch, "report": done.found.report, "loads": done.loads}
        print_json(report)
    else:
        console.print(_table(patch, done) if done.force is None else _fit_table(patch, done.force))
        if unseen := done.found.report.get("not_seen"):
            console.print(f"not seen: {unseen}", style="yellow", highlight=False, markup=False)
        console.print(f"calibration {done.file}", highlight=False, markup=False)
        if out is None:
            words = f"it is beside the description, so all later runs with {robot} use it, also in simulation"
            console.print(words, style="yellow", highlight=False)


def _table(patch: str, done: PatchMeasurement) -> Table:
    noise = median(done.found.noise)
    table = Table(
        title=f"{patch}: {len(done.found.rest)} taxels, median noise {noise:.2f} counts",
        caption="load: force on the skin; before, after: force measured with the response of the description "
        "and with the calibrated response",
        box=box.SIMPLE_HEAD,
    )
    for column in ("load [N]", "before [N]", "after [N]", "error [%]"):
        table.add_column(column.replace("[", "\\["), justify="right")
    for row in done.loads:
        error = 100.0 * (row["after_N"] / row["force_N"] - 1.0)
        table.add_row(*(f"{row[key]:.2f}" for key in ("force_N", "before_N", "after_N")), f"{error:+.1f}")
    return table


def _fit_table(patch: str, fit: ForceFit) -> Table:
    gains = sorted(fit.gains.tolist())
    low, high = gains[len(gains) // 20], gains[-1 - len(gains) // 20]
    table = Table(
        title=f"{patch}: {len(gains)} taxels against a force sensor, offset {fit.offset:.2f} N",
        caption=f"gain: factor of the description's response, median {median(gains):.2f}, {low:.2f} to "
        f"{high:.2f} for nine of ten taxels; error: root mean square, fitted to every other block of frames, "
        "for the blocks between",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("measured by")
    table.add_column("error \\[N]", justify="right")
    for words, error in (
        ("sum of raw values, gain and offset", fit.held_out_raw_sum),
        ("one gain for the patch, offset", fit.held_out_one_gain),
        ("calibration", fit.held_out),
    ):
        table.add_row(words, f"{error:.2f}")
    return table
