"""`tci skin`: real skins, from their calibration files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(help="Look at skins: cones through them, and pictures.", no_args_is_help=True)


@app.command()
def fit(
    file: Annotated[Path, typer.Argument(help="Skin file: iCub calibration (.txt), table (.csv), or URDF.")],
    axis: Annotated[
        tuple[float, float, float], typer.Option(help="The kinematic axis, distally, in the file's frame.")
    ] = (0.0, 0.0, 1.0),
    origin: Annotated[
        tuple[float, float, float], typer.Option(help="A point on that axis [m], in the file's frame.")
    ] = (0.0, 0.0, 0.0),
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Fit the paper's truncated cone to a skin, and say how far the taxels are from it.

    The axis is kept, then may move sideways, then tilt as well.

    Example:  tci skin fit left_forearm.txt --axis 0.9659 0 0.2588
    """
    import numpy as np

    from tci.cli.console import console, print_json
    from tci.errors import TciError
    from tci.model.cone import Freedom
    from tci.model.skin_map import skin_cone
    from tci.model.skin_reader import read_layout

    skin = read_layout(file)
    taxels = skin.positions[skin.taxels]
    kinds: dict[str, Freedom] = {"kinematic": "none", "free centre": "centre", "free axis": "axis"}
    rows: list[dict[str, Any]] = []
    for kind, free in kinds.items():
        try:
            cone = skin_cone(taxels, origin=np.array(origin), axis=np.array(axis), free=free)
        except TciError as error:
            rows.append({"axis": kind, "error": str(error)})
            continue
        cosine = float(np.clip(cone.axis @ np.array(axis) / np.linalg.norm(axis), -1.0, 1.0))
        rows.append(
            {
                "axis": kind,
                "length_mm": cone.length * 1e3,
                "r1_mm": cone.r1 * 1e3,
                "r2_mm": cone.r2 * 1e3,
                "rms_mm": cone.rms * 1e3,
                "max_mm": cone.largest * 1e3,
                "tilt_deg": float(np.degrees(np.arccos(cosine))),
                "origin_m": cone.origin.tolist(),
                "direction": cone.axis.tolist(),
            }
        )
    if as_json:
        print_json({"file": str(file), "name": skin.name, "taxels": len(taxels), "cones": rows})
        return
    console.print(f"[bold]{file.name}[/]  {skin.name}, {len(taxels)} taxels, {skin.channels} channels")
    console.print(_table(rows))
    for row in rows:
        if "error" in row:
            console.print(f"  {row['axis']}: {row['error']}", style="yellow", highlight=False)


def _table(rows: list[dict[str, Any]]) -> Any:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, caption="mm; tilt in degrees against the axis that was given")
    for column in ("axis", "length", "r1", "r2", "rms", "max", "tilt"):
        table.add_column(column, justify="left" if column == "axis" else "right")
    for row in rows:
        if "error" in row:
            table.add_row(row["axis"], *["none"] * 6)
            continue
        keys = ("length_mm", "r1_mm", "r2_mm", "rms_mm", "max_mm", "tilt_deg")
        table.add_row(row["axis"], *(f"{row[key]:.1f}" for key in keys))
    return table


@app.command()
def check(
    robot: Annotated[str, typer.Argument(help="Robot by name, or a description file.")],
    file: Annotated[
        Path | None, typer.Option(help="Skin file to check, in place of the robot's own skin.")
    ] = None,
    link: Annotated[str | None, typer.Option(help="Link that the file's skin is on.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Measure how far taxels are from the surface of their link, and find the correction for a wrong frame.

    Exit status 1 when a skin is not where it should be.

    Example:  tci skin check icub --file right_arm.txt --link r_upper_arm
    """
    from tci.cli.skin_check import check as command

    command(robot, file, link, as_json=as_json)


@app.command()
def locate(
    robot: Annotated[str, typer.Argument(help="Robot by name, or a description file.")],
    patch: Annotated[str, typer.Option(help="Patch of its skin.")],
    touches: Annotated[
        Path | None,
        typer.Option(help="Touches (.csv): x, y, z [m], nx, ny, nz in the patch's link, then the raw frame."),
    ] = None,
    count: Annotated[int, typer.Option(min=3, max=100000, help="Touches, in simulation.")] = 200,
    wrong: Annotated[float, typer.Option(help="Error [m] of the places before, in simulation.")] = 0.010,
    out: Annotated[Path | None, typer.Option(help="Write the places found to this table (.csv).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Find where taxels are, from touches at known places: spatial self-calibration.

    Without --touches a simulated probe touches a skin whose map is wrong, and the error is told.

    Example:  tci skin locate nao --patch left_forearm
    """
    from tci.cli.skin_locate import locate as command

    command(robot, patch, touches=touches, count=count, wrong=wrong, out=out, as_json=as_json)


@app.command()
def calibrate(
    robot: Annotated[str, typer.Argument(help="Robot by name, or a description file.")],
    patch: Annotated[str, typer.Option(help="Skin patch to calibrate.")],
    via: Annotated[str, typer.Option(help="Link to it, NAME or NAME:ADDRESS.")] = "sim",
    weight: Annotated[
        list[float] | None, typer.Option(help="A known load \\[N]; repeat for several, light ones first.")
    ] = None,
    force_log: Annotated[
        Path | None,
        typer.Option(help="Instead: a force sensor's stream, CSV with time,force on the link's clock."),
    ] = None,
    frames: Annotated[int, typer.Option(min=20, help="Frames to take at rest.")] = 200,
    out: Annotated[
        Path | None, typer.Option(help="File to write. [default: beside the robot's description]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON and ask nothing.")] = False,
) -> None:
    """Measure a patch's rest values and noise, and its response under known loads, step by step.

    Without loads the description's response stays. A simulated robot is pressed by its finger. What was
    found is stored beside the description, and used from then on.

    Example:  tci skin calibrate nao --patch left_forearm --weight 0.5 --weight 2 --out nao.skin.json

    Example:  tci skin calibrate icub --patch left_forearm --via replay:loads.mcap --force-log force.csv
    """
    from tci.cli.skin_calibrate import calibrate_patch

    calibrate_patch(
        robot, patch, via=via, weights=weight or [], force_log=force_log, frames=frames, out=out,
        as_json=as_json,
    )  # fmt: skip


@app.command()
def show(
    skin: Annotated[str, typer.Argument(help="Skin file, robot by name, or robot description.")],
    out: Annotated[Path, typer.Option(help="The picture to write (.png).")] = Path("skin.png"),
) -> None:
    """Draw a skin unrolled, x along the limb and theta around it, each taxel with its channel's number.

    Example:  tci skin show left_forearm.txt --out forearm.png
    """
    from tci.cli.console import console
    from tci.cli.skin_picture import draw, maps

    found = maps(skin)
    draw(found, out)
    for one in found:
        console.print(f"{one.title}: {len(one.channels)} taxels", highlight=False)
    console.print(f"picture {out}", highlight=False)
