"""`tci skin`: finds, fits, checks, mounts, locates, calibrates, exports and draws skins."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion
from tci.cli.console import console, print_json
from tci.cli.options import AsJson
from tci.cli.skin_calibrate import calibrate
from tci.cli.skin_check import check
from tci.cli.skin_export import export
from tci.cli.skin_find import find
from tci.cli.skin_fit import fit
from tci.cli.skin_locate import locate
from tci.cli.skin_mount import mount

app = typer.Typer(
    help="Find, fit, check, mount, locate, calibrate, export and draw skins.", no_args_is_help=True
)
for command in (find, fit, check, mount, locate, calibrate, export):
    app.command()(command)


@app.command()
def show(
    skin: Annotated[
        str,
        typer.Argument(
            help="Skin file, name of a robot, or description file of a robot.",
            autocompletion=completion.robots,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Picture to write (.png).")] = Path("skin.png"),
    as_json: AsJson = False,
) -> None:
    """Draw an unrolled skin. The picture shows each taxel with the channel number, at x along the limb and at
    the angle theta around the limb.

    Example:  tci skin show left_forearm.txt --out forearm.png
    """
    from tci.lab.authoring.skin_picture import draw, maps

    found = maps(skin)
    draw(found, out)
    if as_json:
        print_json({"file": str(out), "taxels": {one.title: len(one.channels) for one in found}})
        return
    for one in found:
        console.print(f"{one.title}: {len(one.channels)} taxels", highlight=False, markup=False)
    console.print(f"picture {out}", highlight=False, markup=False)
