"""`tci skin`: fits, checks, locates, calibrates and draws skins."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion
from tci.cli.options import AsJson, RobotName, Via

app = typer.Typer(help="Skins: fit, check, locate, calibrate, draw.", no_args_is_help=True)


@app.command()
def fit(
    skin: Annotated[
        str,
        typer.Argument(
            help="Skin file (.txt as iCub's, .csv, .urdf), name of a robot, or description file.",
            autocompletion=completion.robots,
        ),
    ],
    axis: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="For a file: direction of the limb's axis towards the hand, in its frame. \\[default: 0 0 1]"
        ),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="For a file: a point \\[m] on that axis, in its frame. \\[default: 0 0 0]"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit the paper's truncated cone to a skin, and print the distances of the taxels from it.

    There are three fits: the axis is kept; it may move sideways; it may also tilt. The axes of a robot are
    those of its segments.

    Example:  tci skin fit left_forearm.txt --axis 0.9659 0 0.2588

    Example:  tci skin fit icub
    """
    from tci.cli.skin_fit import fit as command

    command(skin, axis, origin, as_json=as_json)


@app.command()
def check(
    robot: RobotName,
    file: Annotated[
        Path | None, typer.Option(help="Skin file to check instead of the robot's own skin.")
    ] = None,
    link: Annotated[str | None, typer.Option(help="Link that carries the skin of the file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the distances of taxels from the surface of their link, and find the correction of a wrong
    frame.

    Exit status 1 if a skin does not fit its link.

    Example:  tci skin check icub --file right_arm.txt --link r_upper_arm
    """
    from tci.cli.skin_check import check as command

    command(robot, file, link, as_json=as_json)


@app.command()
def locate(
    robot: RobotName,
    patch: Annotated[str, typer.Option(help="Patch of skin to locate.")],
    touches: Annotated[
        Path | None,
        typer.Option(
            help="Touches (.csv): x y z \\[m] and nx ny nz in the patch's link, then the raw frame."
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=3, max=100000, help="Number of touches, in simulation.")] = 200,
    wrong: Annotated[
        float, typer.Option(min=0.0, max=0.1, help="Error \\[m] of the initial positions, in simulation.")
    ] = 0.010,
    out: Annotated[Path | None, typer.Option(help="Table to write the positions to (.csv).")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the positions of taxels from touches at known places (spatial self-calibration).

    Without --touches a simulated probe touches a skin with a wrong map, and the remaining error is printed.

    Example:  tci skin locate nao --patch left_forearm
    """
    from tci.cli.skin_locate import locate as command

    command(robot, patch, touches=touches, count=count, wrong=wrong, out=out, as_json=as_json)


@app.command()
def calibrate(
    robot: RobotName,
    patch: Annotated[str, typer.Option(help="Patch of skin to calibrate.")],
    via: Via = "sim",
    weight: Annotated[
        list[float] | None, typer.Option(help="Known load \\[N]; repeat for several, light ones first.")
    ] = None,
    force_log: Annotated[
        Path | None,
        typer.Option(
            help="Instead of weights: readings of a force sensor, CSV with time,force on the driver's clock."
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=20, help="Number of frames to take at rest.")] = 200,
    out: Annotated[
        Path | None, typer.Option(help="Calibration to write. \\[default: beside the robot's description]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON and ask nothing.")] = False,
) -> None:
    """Measure a patch's rest values and noise, and its response to known loads, step by step.

    Without loads the response in the description is kept. A simulated robot is pressed by the simulated
    finger. The result is stored beside the description and used from then on.

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
    skin: Annotated[
        str,
        typer.Argument(
            help="Skin file, name of a robot, or description file.", autocompletion=completion.robots
        ),
    ],
    out: Annotated[Path, typer.Option(help="Picture to write (.png).")] = Path("skin.png"),
    as_json: AsJson = False,
) -> None:
    """Draw an unrolled skin: x along the limb, theta around it, each taxel with the number of its channel.

    Example:  tci skin show left_forearm.txt --out forearm.png
    """
    from tci.cli.console import console, print_json
    from tci.cli.skin_picture import draw, maps

    found = maps(skin)
    draw(found, out)
    if as_json:
        print_json({"file": str(out), "taxels": {one.title: len(one.channels) for one in found}})
        return
    for one in found:
        console.print(f"{one.title}: {len(one.channels)} taxels", highlight=False, markup=False)
    console.print(f"picture {out}", highlight=False, markup=False)
