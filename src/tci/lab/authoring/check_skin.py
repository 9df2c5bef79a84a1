"""Comparison of the positions of taxels with the mesh of their link."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tci.errors import CommandError, DescriptionError
from tci.lab.authoring.registration import Registration, link_surface, register
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface


def check_skins(
    robot: Robot,
    file: Path | None = None,
    link: str | None = None,
    *,
    progress: Callable[[str, int, int], None] = lambda skin, done, count: None,
) -> list[dict[str, Any]]:
    """Compares a skin file with the mesh of `link`, or every patch of a robot with the mesh of the patch's
    link. Returns one row of distances for each skin.

    Each row consists of JSON values. For a patch, the row contains `mount`, a corrected pose. With this pose
    in the description, the patch lies on the mesh. `progress` is called before each skin with its name, the
    number of skins that are done, and the number of all skins. Raises CommandError for `file` without `link`,
    `link` without `file`, or a robot without skin.
    """
    if (file is None) != (link is None):
        raise CommandError("--file and --link need each other; valid: --file FILE --link LINK")
    rows: list[dict[str, Any]] = []
    skins = _patches(robot) if file is None or link is None else [(file.name, link, _taxels(file))]
    for done, (title, where, taxels) in enumerate(skins):
        progress(title, done, len(skins))
        row: dict[str, Any] = {"skin": title, "link": where, "taxels": len(taxels)}
        try:
            found = register(taxels, link_surface(robot, where))
            row |= _facts(found)
            if file is None:  # the description may already contain a pose of the patch
                row["mount"] = _pose(found.correction @ robot.patch(title).mount)
        except DescriptionError as error:
            row |= {"verdict": "not checked", "reason": error.faults[0].message}
        rows.append(row)
    return rows


def _taxels(file: Path) -> np.ndarray:
    skin = read_layout(file)
    return np.array(skin.positions[skin.valid])


def _patches(robot: Robot) -> list[tuple[str, str, np.ndarray]]:
    if not robot.skin:
        raise CommandError(
            f"{robot.name} has no skin to check; valid: a robot with taxels, or --file and --link"
        )
    kinematics = KinematicChain(robot)
    return [
        (patch.name, patch.link, build_surface(robot, patch, kinematics).positions) for patch in robot.skin
    ]


def _facts(found: Registration) -> dict[str, Any]:
    return {
        "mean_mm": found.mean * 1e3,
        "max_mm": found.largest * 1e3,
        "verdict": "fits" if found.fits else "wrong",
        "correction": {
            "mends": found.mends,
            "mean_mm": found.corrected_mean * 1e3,
            "max_mm": found.corrected_largest * 1e3,
            **_pose(found.correction),
            "R": found.correction[:3, :3].tolist(),
        },
    }


def _pose(pose: Array) -> dict[str, list[float]]:
    rpy = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return {"xyz_m": pose[:3, 3].tolist(), "rpy_deg": rpy.tolist()}
