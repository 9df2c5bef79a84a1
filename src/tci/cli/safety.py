"""`tci safety`: predicts how hard the links of a robot may strike or squeeze people."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.lab.experiments.safety_report import SafetyReport

SHOWN = 12
"""Rows in the terminal; the files have all of them."""


def safety(
    robot: RobotName,
    impacts: Annotated[int, typer.Option(min=1, help="Contacts to draw.")] = 10_000,
    limits: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of what people may get: region, stiffness_N_mm, mass_kg, force_N, pressure_N_cm2 "
            "(quasi-static; twice as much for a moment)."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for report.html and report.json. \\[default: out/safety-ROBOT; none with --json]"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict how hard the links of ROBOT may strike or squeeze people.

    Joints go as fast as their limits allow; a person is free to move, or can't give way. A prediction, no
    certificate, for adults only. The worst contact of each kind is simulated besides.

    Example:  tci safety nao
    """
    from rich.progress import Progress

    from tci.lab.experiments.impacts import Impacts
    from tci.lab.experiments.safety_report import Limits, report_of
    from tci.robot.catalogue import load_robot

    words = load_robot(robot)
    given = Limits() if limits is None else Limits.read(limits)
    folder = out or Path("out", f"safety-{words.name}")
    if folder.exists() and not folder.is_dir():
        raise CommandError(f"{folder} is a file; valid: --out FOLDER, for report.html and report.json")
    with Progress(console=console, transient=True, disable=as_json or not console.is_terminal) as bar:
        task = bar.add_task("contacts", total=impacts)
        drawn = Impacts(words).draw(
            impacts, given.people, seed=seed, progress=lambda done: bar.update(task, completed=done)
        )
        report = report_of(words, drawn, given, seed=seed)
    if out is not None or not as_json:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.json").write_text(json.dumps(report.to_json(), indent=1))
        (folder / "report.html").write_text(report.to_html())
    if as_json:
        print_json(report.to_json())
        return
    _show(report)
    console.print(f"all {len(report.rows)} rows: {folder / 'report.html'}", highlight=False, markup=False)


def _show(report: SafetyReport) -> None:
    from rich.table import Table

    from tci.lab.experiments.impact_replay import replay
    from tci.lab.experiments.safety_report import HEAD

    console.print(HEAD, style="yellow", highlight=False)
    table = Table(
        title=f"{report.robot.name}: the worst of {report.impacts} contacts",
        caption="peak: if nothing notices the contact, and if TCI does after "
        f"{report.parameters['reaction_s'] * 1e3:.0f} ms (equal where the peak comes sooner, more in a few); "
        "over: share of contacts over the limit; held: what lasts if nothing lets go",
        box=box.SIMPLE_HEAD, pad_edge=False,
    )  # fmt: skip
    for name in (
        "link",
        "region",
        "case",
        "peak\nN",
        "with TCI\nN",
        "limit\nN",
        "over",
        "held\nN",
        "limit\nN",
    ):
        table.add_column(name, justify="left" if name in ("link", "region", "case") else "right")
    for row in report.rows[:SHOWN]:
        one = row.worst
        forces = (f"{force:.0f}" for force in (one.unanswered, one.answered, one.limit))
        table.add_row(
            row.link, row.region, "clamped" if row.clamped else "free", *forces, f"{row.over:.0%}",
            f"{row.held:.0f}" if row.clamped else "", f"{0.5 * one.limit:.0f}" if row.clamped else "",
            style="red" if row.margin < 0.0 else "",
        )  # fmt: skip
    console.print(table)
    over = sum(row.margin < 0.0 for row in report.rows)
    console.print(
        f"{over} of {len(report.rows)} pairs of link and region pass their limit somewhere", highlight=False
    )
    for clamped in (False, True):
        for row in [row for row in report.rows if row.clamped is clamped][:1]:
            force = replay(report.robot, row.worst)
            case = "clamped" if clamped else "free"
            console.print(
                f"worst {case} contact: {row.link} on {row.region}, predicted {row.worst.answered:.0f} N, "
                f"simulated {force:.0f} N", highlight=False, markup=False,
            )  # fmt: skip
    if report.assumed:
        console.print(
            f"speed, acceleration or torque of {len(report.assumed)} of {len(report.robot.servos)} servos is "
            "assumed: the figures are as good as these (tci describe)", style="yellow", highlight=False,
        )  # fmt: skip
