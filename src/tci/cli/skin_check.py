"""`tci skin check`: compares the positions of taxels with the mesh of their link."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich import box
from rich.table import Table
from scipy.spatial.transform import Rotation

from tci.authoring.registration import Registration, link_surface, register
from tci.cli.console import console, print_json
from tci.errors import CommandError, DescriptionError
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface


def check(name: str, file: Path | None, link: str | None, *, as_json: bool) -> None:
    """Checks one skin file on one link, or every patch of a robot, and prints the distances.

    Raises CommandError for a file without a link, or a link without a file. Exit status 1 if a skin is wrong.
    """
    robot = load_robot(name)
    if (file is None) != (link is None):
        raise CommandError("--file and --link need each other; valid: --file FILE --link LINK")
    rows: list[dict[str, Any]] = []
    skins = _patches(robot) if file is None or link is None else [(file.name, link, _taxels(file))]
    with console.status("comparing taxels with meshes"):
        for title, where, taxels in skins:
            row: dict[str, Any] = {"skin": title, "link": where, "taxels": len(taxels)}
            try:
                row |= _facts(register(taxels, link_surface(robot, where)))
            except DescriptionError as error:
                row |= {"verdict": "not checked", "reason": error.faults[0].message}
            rows.append(row)
    if as_json:
        print_json({"robot": robot.name, "skins": rows})
    else:
        console.print(_table(robot, rows))
        for row in rows:
            _advise(row)
    if any(row["verdict"] == "wrong" for row in rows):
        raise typer.Exit(1)


def _taxels(file: Path) -> np.ndarray:
    skin = read_layout(file)
    return np.array(skin.positions[skin.valid])


def _patches(robot: Robot) -> list[tuple[str, str, np.ndarray]]:
    kinematics = KinematicChain(robot)
    return [
        (patch.name, patch.link, build_surface(robot, patch, kinematics).positions) for patch in robot.patches
    ]


def _facts(found: Registration) -> dict[str, Any]:
    rpy = Rotation.from_matrix(found.correction[:3, :3]).as_euler("xyz", degrees=True)
    return {
        "mean_mm": found.mean * 1e3,
        "max_mm": found.largest * 1e3,
        "verdict": "fits" if found.fits else "wrong",
        "correction": {
            "mends": found.mends,
            "mean_mm": found.corrected_mean * 1e3,
            "max_mm": found.corrected_largest * 1e3,
            "xyz_m": found.correction[:3, 3].tolist(),
            "rpy_deg": rpy.tolist(),
            "R": found.correction[:3, :3].tolist(),
        },
    }


def _table(robot: Robot, rows: list[dict[str, Any]]) -> Table:
    table = Table(
        title=f"taxels of {robot.name} against the meshes of their links",
        caption="distances in mm; corrected: mean after the best rigid correction",
        box=box.SIMPLE_HEAD,
    )
    for column in ("skin", "link", "taxels", "mean", "max", "corrected", "verdict"):
        table.add_column(column, justify="left" if column in ("skin", "link", "verdict") else "right")
    colours = {"fits": "green", "wrong": "red", "not checked": "yellow"}
    for row in rows:
        numbers = ["", "", ""]
        if "mean_mm" in row:
            numbers = [f"{row['mean_mm']:.2f}", f"{row['max_mm']:.1f}", f"{row['correction']['mean_mm']:.2f}"]
        verdict = f"[{colours[row['verdict']]}]{row['verdict']}[/]"
        table.add_row(row["skin"], row["link"], str(row["taxels"]), *numbers, verdict)
    return table


def _advise(row: dict[str, Any]) -> None:
    """Prints the correction of a skin in a wrong frame, or the reason why there is none."""
    if row["verdict"] == "not checked":
        console.print(f"{row['skin']}: {row['reason']}", style="yellow", highlight=False, markup=False)
    elif row["verdict"] == "wrong" and row["correction"]["mends"]:
        correction = row["correction"]
        xyz = " ".join(f"{value:.4f}" for value in correction["xyz_m"])
        rpy = " ".join(f"{value:.2f}" for value in correction["rpy_deg"])
        console.print(
            f"{row['skin']} is in a wrong frame. This correction leaves a mean distance of "
            f"{correction['mean_mm']:.2f} mm:\n"
            f'  <table file="..." format="icub" xyz="{xyz}" rpy="{rpy}" type="deg"/>\n'
            "  Look at the result before you use it (tci view): round limbs allow more than one correction.",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
    elif row["verdict"] == "wrong":
        console.print(
            f"{row['skin']}: no rigid correction puts it on {row['link']}; check the link and the robot",
            highlight=False, markup=False,
        )  # fmt: skip
