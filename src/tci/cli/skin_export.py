"""`tci skin export`: a robot's skin for other programs, with its model or alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName
from tci.errors import UnknownNameError

KINDS = {"urdf": ".urdf", "mjcf": ".xml", "json": ".json"}


def export(
    robot: RobotName,
    to: Annotated[
        str,
        typer.Option(
            help="urdf: <sensor><tactile> of tactile_toolbox; mjcf: a site and <touch> per taxel; "
            "json: the skin alone, for mjlab."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File to write. \\[default: NAME_skin.urdf, .xml or .json]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a robot's model with its skin as URDF or MJCF, or the skin alone as JSON, for other programs.

    Example:  tci skin export g1-inspire --to mjcf
    """
    from tci.batch.skin_file import skin_to_json
    from tci.exports.skin_models import skin_to_mjcf, skin_to_urdf
    from tci.robot.catalogue import load_robot
    from tci.skin.surfaces import surfaces_of

    if to not in KINDS:
        raise UnknownNameError("format", to, list(KINDS))
    found = load_robot(robot)
    write = {"urdf": skin_to_urdf, "mjcf": skin_to_mjcf, "json": skin_to_json}[to]
    text = write(found)
    target = out or Path(f"{found.name}_skin{KINDS[to]}")
    target.write_text(text, encoding="utf-8")
    worn = zip(found.patches, surfaces_of(found), strict=True)
    taxels = sum(len(surface.positions) for patch, surface in worn if not patch.through_joints)
    if as_json:
        print_json({"file": str(target), "patches": len(found.skin), "taxels": taxels})
        return
    console.print(
        f"wrote {target}: {len(found.skin)} patches, {taxels} taxels", highlight=False, markup=False
    )
