"""`tci demo`: the main job, its table, its picture and its report."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import typer
from rich import box
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tci.authoring.dense_skin import with_skin_rate
from tci.capabilities.withdrawal import MODES, WithdrawalReflex
from tci.cli.console import console, print_json
from tci.errors import MissingExtraError, UnknownNameError
from tci.experiments.experiment import SIDES, Report, run_experiment
from tci.experiments.measure import Trial
from tci.experiments.pictures import draw_demo
from tci.experiments.remote_trial import try_server
from tci.messages import Mode
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot

PAPER = ("icub", "nao")
"""The paper's two robots."""


def demo(
    names: Sequence[str],
    *,
    mode: str,
    out: Path,
    seed: int,
    headless: bool,
    skin_rate: float | None,
    via: str | None = None,
    as_json: bool,
) -> None:
    """Run every trial on every robot, then print, draw and write what was measured.

    Raises UnknownNameError for a mode that the reflex does not have, and for a middleware that does not
    reach a robot; what `try_server` raises.
    """
    robots = load_robots(names)
    if via is not None:
        middleware = via.partition(":")[0]
        for robot in robots:
            robot.binding(middleware)
        try_server(robots[0], via)
    if skin_rate is not None:
        robots = [with_skin_rate(robot, skin_rate) for robot in robots]
    reflex = WithdrawalReflex(mode=_mode(mode))
    out.mkdir(parents=True, exist_ok=True)
    columns = (TextColumn("{task.description:<44}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=as_json) as progress:
        task = progress.add_task(
            "building the worlds", total=len(robots) * len(SIDES) * len(reflex.fields) + 1
        )

        def advance(trial: Trial) -> None:
            what = f"poked {trial.robot}, {trial.side} {trial.site.replace('_', ' ')}"
            progress.update(task, advance=1, description=what)

        report = run_experiment(robots, reflex, seed=seed, via=via, progress=advance)
        progress.update(task, description="drawing the picture")
        picture = out / "demo.png"
        draw_demo(robots, reflex, picture, seed=seed)
        progress.update(task, advance=1, description="done")
    path = out / "report.json"
    path.write_text(json.dumps(report.to_json(), indent=2, allow_nan=False) + "\n")
    if as_json:
        print_json(report.to_json())
        return
    console.print(_table(report, mode))
    _summary(report, robots)
    console.print(f"picture {picture}\nreport  {path}", highlight=False, markup=False)
    if not headless and sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform != "linux"):
        typer.launch(str(picture))


def _mode(name: str) -> Mode:
    """The form of the reflex by name."""
    for mode in MODES:
        if mode.value == name:
            return mode
    raise UnknownNameError("mode of the withdrawal reflex", name, [mode.value for mode in MODES])


def load_robots(names: Sequence[str]) -> list[Robot]:
    """The robots asked for, or those of the paper that are installed."""
    if names:
        return [load_robot(name) for name in names]
    robots = []
    for name in PAPER:
        try:
            robots.append(load_robot(name))
        except MissingExtraError as error:
            typer.secho(f"without {name}: {error}", fg="yellow", err=True)
    return robots


def _table(report: Report, mode: str) -> Table:
    table = Table(
        title=f"One reflex on every robot, in {mode} mode: a finger pokes, the arm withdraws",
        caption="Times count from first contact; lost: the finger no longer touches. CoP: error of the "
        "centre of pressure. Away: how far the skin withdrew; without: with the reflex switched off.",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    table.add_column("site", no_wrap=True)
    for name in ("command\nms", "motion\nms", "lost\nms", "peak\nN", "CoP\nmm", "away\nmm", "without\nmm",
                 "limits\nbroken"):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    arm = ("", "")
    for trial in report.trials:
        if (trial.robot, trial.side) != arm:
            arm = (trial.robot, trial.side)
            table.add_section()
            table.add_row(f"[bold]{trial.robot}, {trial.side} arm[/]")
        table.add_row(
            f"  {trial.site.replace('_', ' ')}",
            _number(trial.trigger_ms),
            _number(trial.first_motion_ms),
            _number(trial.contact_lost_ms),
            f"{trial.peak_force_n:.1f}",
            _number(trial.cop_error_mm, ".1f"),
            f"{trial.withdrawn_mm:.0f}",
            f"{trial.withdrawn_without_reflex_mm:.1f}",
            f"[red]{trial.limit_violations}[/]" if trial.limit_violations else "[green]0[/]",
        )
    return table


def _number(value: float | None, form: str = ".0f") -> str:
    return "[red]never[/]" if value is None else format(value, form)


def _summary(report: Report, robots: Sequence[Robot]) -> None:
    trials = report.trials
    responded = sum(trial.responded for trial in trials)
    lost = sum(trial.contact_lost_ms is not None for trial in trials)
    console.print(f"{responded} of {len(trials)} pokes answered, contact lost in {lost}")
    if len(robots) > 1:
        same = report.same_stimulus
        console.print(
            f"the same touch on {' and '.join(robot.name for robot in robots)}: generic motions differ by "
            f"{same.max_generic_difference_rad:.0e} rad, hand directions by at most "
            f"{max(same.hand_direction_deg.values()):.1f} degrees seen from the shoulder, "
            f"{max(same.hand_direction_torso_deg.values()):.1f} from the torso"
        )
    for trial in trials:
        for what in (*trial.violations, *trial.halts):
            console.print(f"[red]{trial.robot} {trial.side} {trial.site}: {escape(what)}[/]")
