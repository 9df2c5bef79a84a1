"""`tci skin fit`: fits a truncated cone (eq. 4 of the paper) to a skin."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from tci.cli import completion
from tci.cli.console import console, print_json
from tci.cli.options import AsJson


def fit(
    skin: Annotated[
        str,
        typer.Argument(
            help="Skin file (.txt in iCub's format, .csv, .urdf), name of a robot, or description file.",
            autocompletion=completion.robots,
        ),
    ],
    axis: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="For a skin file: direction of the limb's axis towards the hand, in the frame of the "
            "file. \\[default: 0 0 1]"
        ),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="For a skin file: a point \\[m] on the limb's axis, in the frame of the file. "
            "\\[default: 0 0 0]"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a truncated cone (eq. 4 of the paper) to a skin, and print the distances between the taxels and
    this cone.

    The command computes three fits: with the given axis, with an axis that may also move sideways, and with
    an axis that may also tilt. For a robot, the given axes are the axes of the robot's segments.

    Example:  tci skin fit left_forearm.txt --axis 0.9659 0 0.2588

    Example:  tci skin fit icub
    """
    from tci.lab.authoring.fit_skin import fit_skins

    fitted = fit_skins(skin, axis, origin)
    if as_json:
        print_json(
            {"file": skin, **fitted[0]} if Path(skin).is_file() and len(fitted) == 1 else {"skins": fitted}
        )
        return
    for one in fitted:
        console.print(f"[bold]{one['name']}[/]  {one['taxels']} taxels, {one['channels']} channels")
        console.print(
            f"lattice: pitch {one['pitch_mm']:.1f} mm; taxels up to {one['neighbours_mm']:.1f} mm apart are "
            "neighbours, so that pressed ones are one contact",
            highlight=False, markup=False,
        )  # fmt: skip
        if one["note"]:
            console.print(one["note"], style="yellow", highlight=False, markup=False)
        console.print(_table(one["cones"]))
        for row in one["cones"]:
            if "error" in row:
                console.print(f"  {row['axis']}: {row['error']}", style="yellow", highlight=False)


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, caption="mm; tilt: degrees from the given axis")
    for column in ("axis", "length", "r1", "r2", "rms", "max", "tilt"):
        table.add_column(column, justify="left" if column == "axis" else "right")
    for row in rows:
        if "error" in row:
            table.add_row(row["axis"], *["none"] * 6)
            continue
        keys = ("length_mm", "r1_mm", "r2_mm", "rms_mm", "max_mm", "tilt_deg")
        table.add_row(row["axis"], *(f"{row[key]:.1f}" for key in keys))
    return table
