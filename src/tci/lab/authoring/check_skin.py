"""Comparison of the positions of taxels with the mesh of their link."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tci.errors import CommandError, DescriptionError
from tci.lab.authoring.registration import FITS, Registration, link_surface, register
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface

SHARE = 0.1
"""Share of a sleeve over another link from which it is told."""
FEWEST = 10
"""Least number of taxels for which a correction is computed."""
OFF = 0.025
"""Mean distance [m] up to which an assumed sleeve fits. Assumed: a cone around the widest places of a link
stands off its narrow ones by up to 20 mm on the humanoids that were tried."""
QUARTER, AWAY = 0.25, 0.03
"""At least the fraction QUARTER of a patch's taxels must be at most AWAY [m] from the surface of the patch's
link or of an adjacent link. Assumed: models lack covers (soles of NAO: 21 mm) and pieces of forearms (alex:
27 mm)."""


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
    skins = _patches(robot) if file is None or link is None else [(file.name, (link,), _taxels(file))]
    for done, (title, links, taxels) in enumerate(skins):
        progress(title, done, len(skins))
        row: dict[str, Any] = {"skin": title, "link": " ".join(links), "taxels": len(taxels)}
        try:
            surface = link_surface(robot, *links)
            patch = None if file is not None else robot.patch(title)
            if len(taxels) < FEWEST or (patch is not None and patch.assumed):
                row |= _measured(surface.distances(taxels), patch)
                continue
            found = register(taxels, surface)
            row |= _facts(found)
            if patch is not None:  # the description may already contain a pose of the patch
                row["mount"] = _pose(found.correction @ patch.mount)
        except DescriptionError as error:
            row |= {"verdict": "not checked", "reason": error.faults[0].message}
        finally:
            rows.append(row)
    return rows


def _taxels(file: Path) -> np.ndarray:
    skin = read_layout(file)
    return np.array(skin.positions[skin.valid])


def carriers(robot: Robot, patch: Patch) -> tuple[str, ...]:
    """The links over which a patch lies, its own first: those fixed to it and, for a sleeve, all links of its
    segment, which on most arms are two, before and after a roll."""
    kinematics = KinematicChain(robot)
    own = kinematics.chain(patch.link)
    moves = {own}
    if robot.limb_segment(patch) is not None:
        joints = robot.part(patch.part).servos
        ends = [
            generic.servo for generic in joints[slice(3, 5) if patch.segment == "forearm" else slice(1, 3)]
        ]
        chains = {kinematics.chain(link) for link in kinematics.links}
        moves |= {chain for chain in chains if chain and chain[-1] in ends}
    return patch.link, *(
        link for link in kinematics.links if link != patch.link and kinematics.chain(link) in moves
    )


def spans(robot: Robot) -> list[str]:
    """A note on each assumed sleeve of which a tenth or more lies over another link than its own, which turns
    against it."""
    notes = []
    for patch in robot.patches:
        if not patch.assumed or robot.limb_segment(patch) is None:
            continue
        taxels = build_surface(robot, patch, KinematicChain(robot)).positions
        near = {}
        for link in carriers(robot, patch):
            with suppress(DescriptionError):  # a link without a mesh
                near[link] = link_surface(robot, link, frame=patch.link).distances(taxels)
        for link, distances in near.items():
            others = [other for name, other in near.items() if name != link]
            share = float(np.mean(distances <= np.min(others, axis=0))) if others else 0.0
            if link != patch.link and share >= SHARE:
                notes.append(
                    f"{patch.name}: {share:.0%} of it lies over {link}, which turns against {patch.link}"
                )
    return notes


def _patches(robot: Robot) -> list[tuple[str, tuple[str, ...], np.ndarray]]:
    if not robot.skin:
        raise CommandError(
            f"{robot.name} has no skin to check; valid: a robot with taxels, or --file and --link"
        )
    kinematics = KinematicChain(robot)
    return [
        (patch.name, carriers(robot, patch), build_surface(robot, patch, kinematics).positions)
        for patch in robot.skin
    ]


def _measured(distances: Array, patch: Patch | None) -> dict[str, Any]:
    """Distances without a correction: of a few taxels, or of an assumed sleeve, which stands off a link that
    isn't round. A sleeve that is farther off and that `tci check` passes is loose."""
    mean = float(distances.mean())
    sleeve = patch is not None and patch.assumed
    loose = sleeve and float(np.quantile(distances, QUARTER)) <= AWAY
    return {
        "mean_mm": 1e3 * mean,
        "max_mm": 1e3 * float(distances.max()),
        "verdict": "fits" if mean <= (OFF if sleeve else FITS) else "loose" if loose else "wrong",
    }


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
