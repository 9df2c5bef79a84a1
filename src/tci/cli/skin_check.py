"""`tci skin check`: compares the positions of taxels with the mesh of the link that carries the taxels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import box
from rich.table import Table

from tci.cli.console import console, print_json, told_here
from tci.cli.options import AsJson, RobotName
from tci.errors import DescriptionError, Fault

if TYPE_CHECKING:
    from tci.robot.description import Robot


def check(
    robot: RobotName,
    file: Annotated[
        Path | None, typer.Option(help="Skin file to check instead of the robot's own skin.")
    ] = None,
    link: Annotated[str | None, typer.Option(help="Link that carries the skin of the file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the distances between taxels and the surface of the links that carry them: a sleeve may lie
    over two links. If the frame of the taxels is wrong, compute the correction of the frame.

    The exit status is 1 if a skin does not fit its link, or if tci check refuses the robot.

    Example:  tci skin check icub --file right_arm.txt --link r_upper_arm
    """
    from rich.progress import Progress

    from tci.lab.authoring.check_skin import check_skins
    from tci.robot.catalogue import load_robot

    words = load_robot(robot)
    if file is None:
        _refuse_if_useless(words)
    with Progress(console=console, transient=True, disable=as_json or not console.is_terminal) as bar:
        task = bar.add_task("")
        rows = check_skins(
            words, file, link,
            progress=lambda skin, done, of: bar.update(task, description=skin, completed=done, total=of),
        )  # fmt: skip
    if as_json:
        print_json({"robot": words.name, "skins": rows})
    else:
        console.print(_table(words.name, rows))
        for row in rows:
            _advise(row)
    if any(row["verdict"] == "wrong" for row in rows):
        raise typer.Exit(1)


def _refuse_if_useless(robot: Robot) -> None:
    """Raises DescriptionError if tci check would refuse the robot."""
    from tci.lab.experiments.verdict import judge  # a skin file alone needs no simulation

    with told_here():
        faults = judge(robot).faults
    if faults:
        raise DescriptionError(robot.source, [Fault(0, fault) for fault in faults])


def _table(robot: str, rows: list[dict[str, Any]]) -> Table:
    table = Table(
        title=f"taxels of {robot} against the meshes of their links",
        caption="distances in mm; corrected: mean after the best rigid correction",
        box=box.SIMPLE_HEAD,
    )
    for column in ("skin", "link", "taxels", "mean", "max", "corrected", "verdict"):
        table.add_column(column, justify="left" if column in ("skin", "link", "verdict") else "right")
    colours = {"fits": "green", "loose": "yellow", "wrong": "red", "not checked": "yellow"}
    for row in rows:
        numbers = ["", "", ""]
        if "mean_mm" in row:
            corrected = f"{row['correction']['mean_mm']:.2f}" if "correction" in row else ""
            numbers = [f"{row['mean_mm']:.2f}", f"{row['max_mm']:.1f}", corrected]
        verdict = f"[{colours[row['verdict']]}]{row['verdict']}[/]"
        table.add_row(row["skin"], row["link"], str(row["taxels"]), *numbers, verdict)
    return table


def _advise(row: dict[str, Any]) -> None:
    """Prints the correction of a skin with a wrong frame, or the reason why no correction was found."""
    if row["verdict"] == "not checked":
        console.print(f"{row['skin']}: {row['reason']}", style="yellow", highlight=False, markup=False)
    elif row["verdict"] == "loose":
        off = f"{row['mean_mm']:.0f} mm off {row['link']} in the mean; valid: at most 25"
        words = f"{row['skin']}: {off}, or a model without its covers"
        console.print(words, style="yellow", highlight=False, markup=False)
    elif row["verdict"] == "wrong" and "correction" not in row:
        console.print(f"{row['skin']}: it is off {row['link']}", highlight=False, markup=False)
    elif row["verdict"] == "wrong" and row["correction"]["mends"]:
        pose = row.get("mount", row["correction"])
        xyz = " ".join(f"{value:.4f}" for value in pose["xyz_m"])
        rpy = " ".join(f"{value:.2f}" for value in pose["rpy_deg"])
        element = f'patch name="{row["skin"]}"' if "mount" in row else 'table file="..." format="icub"'
        console.print(
            f"{row['skin']} is in a wrong frame. This correction leaves a mean distance of "
            f"{row['correction']['mean_mm']:.2f} mm:\n"
            f'  <{element} xyz="{xyz}" rpy="{rpy}" type="deg"/>\n'
            "  Look at the result before you use it (tci view): round limbs allow more than one correction.",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
    elif row["verdict"] == "wrong":
        console.print(
            f"{row['skin']}: no rigid correction puts it on {row['link']}; check the link and the robot",
            highlight=False, markup=False,
        )  # fmt: skip
