"""`tci skin find`: the tactile pads that a robot model already has."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson

if TYPE_CHECKING:
    from tci.lab.authoring.find_pads import FoundPads, Pad


def find(
    model: Annotated[Path, typer.Argument(help="URDF, MJCF or SDF file of any robot.")],
    meshes: Annotated[
        str | None,
        typer.Option(help='Folder of meshes that are not at their paths; "none": without meshes.'),
    ] = None,
    also: Annotated[
        list[str] | None,
        typer.Option(help="Link to take too, although nothing says that it feels. Repeat it for several."),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(help="Device of the table that the pads belong to, if their size can't tell it."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find the tactile pads of a model: links, sites and sensors, with outline, rows and columns.

    Rows and columns come from a table of devices, whose pads are compared with the outlines in the model. A
    pad that no device fits counts as one taxel. What looks like a pad and is none is listed with the reason.

    Example:  tci skin find g1_with_inspire_hand.urdf
    """
    from tci.lab.authoring.find_pads import find_pads

    found = find_pads(model, meshes=meshes, also=also or (), wanted=device)
    if as_json:
        print_json({"model": str(model), **pads_as_json(found)})
        return
    for line in [*map(_line, found.pads), *found.lines()]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def pads_as_json(found: FoundPads) -> dict[str, Any]:
    """What was found and left out, as JSON values."""
    return {
        "pads": [_facts(pad) for pad in found.pads],
        "found": found.members,
        "taxels": sum(pad.taxels for pad in found.pads),
        "left_out": [{"why": why, "names": list(names)} for why, names in found.left_out.items()],
        "remarks": list(found.notes),
    }


def _facts(pad: Pad) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "name": pad.name, "link": pad.link, "how": pad.how, "members": list(pad.members),
        "taxels": pad.taxels, "device": None if pad.device is None else pad.device.name,
        "thickness": pad.thickness,
    }  # fmt: skip
    if pad.grid is not None and not pad.modules:
        facts["grid"] = pad.grid.model_dump(exclude={"kind", "thickness"})
    return facts


def _line(pad: Pad) -> str:
    grid = None if pad.modules else pad.grid
    size = "" if grid is None else f", {1e3 * grid.length:.1f} x {1e3 * grid.width:.1f} mm"
    thick = f", {1e3 * pad.thickness:.1f} mm thick" if pad.thickness else ""
    shape = f"{pad.taxels} taxels" if grid is None else f"{grid.rows} x {grid.columns}"
    return f"{pad.name}: {shape}{size}{thick} ({pad.how}, {pad.link})"
