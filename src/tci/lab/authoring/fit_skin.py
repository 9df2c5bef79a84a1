"""Fits a truncated cone (eq. 4 of the paper), a simple model of a limb's surface, to the skins of a file or a
robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, TciError
from tci.exports.cone import Freedom, limb_axis
from tci.lab.authoring.skin_map import skin_cone
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface, lattice_pitch, neighbour_distance

KINDS: dict[str, Freedom] = {"kinematic": "none", "free centre": "centre", "free axis": "axis"}
Skin = tuple[str, int, Array, Array, Array, str, float | None]
"""A skin to fit, in this order:

- name, and number of channels
- taxel positions (n, 3) [m]
- a point (3,) [m] on the axis, and the direction (3,) of the axis
- a note on the skin file
- largest distance [m] between neighbouring taxels that the description sets; None if it sets none
"""


def fit_skins(skin: str, axis: ArrayLike | None, origin: ArrayLike | None) -> list[dict[str, Any]]:
    """Returns the cones fitted to one skin file, or to every patch on a limb of a robot, as JSON values.

    `axis` (3,) and `origin` (3,) [m] define the axis of the limb; both arguments are allowed only for a skin
    file. Raises CommandError if `axis` or `origin` is given for a robot, and TciError for a robot without
    skin on limbs.
    """
    return [_fits(one) for one in _skins(skin, axis, origin)]


def _skins(skin: str, axis: ArrayLike | None, origin: ArrayLike | None) -> Iterator[Skin]:
    path = Path(skin)
    if path.is_file() and path.suffix != ".xml":
        file = read_layout(path)
        along, through = np.array(axis or (0.0, 0.0, 1.0)), np.array(origin or (0.0, 0.0, 0.0))
        taxels = file.positions[file.taxels]
        yield file.name or path.name, file.channels, taxels, through, along, file.note, None
        return
    robot = load_robot(skin)
    if axis is not None or origin is not None:
        raise CommandError("--axis and --origin are for skin files only; valid: without them for a robot")
    kinematics = KinematicChain(robot)
    limbs = [patch for patch in robot.patches if robot.limb_segment(patch)]
    if not limbs:
        raise TciError(f"{robot.name} has no skin on a limb to fit a cone to; valid: a skin file")
    for patch in limbs:
        surface = build_surface(robot, patch, kinematics)
        yield (
            patch.name,
            patch.channels,
            surface.positions,
            *limb_axis(robot, surface, kinematics),
            "",
            patch.neighbours,
        )


def _fits(skin: Skin) -> dict[str, Any]:
    name, channels, taxels, origin, axis, note, given = skin
    rows: list[dict[str, Any]] = []
    for kind, free in KINDS.items():
        try:
            cone = skin_cone(taxels, origin=origin, axis=axis, free=free)
        except TciError as error:
            rows.append({"axis": kind, "error": str(error)})
            continue
        cosine = float(np.clip(cone.axis @ axis / np.linalg.norm(axis), -1.0, 1.0))
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
    return {
        "name": name,
        "taxels": len(taxels),
        "channels": channels,
        "note": note,
        "pitch_mm": lattice_pitch(taxels) * 1e3,
        "neighbours_mm": (given or neighbour_distance(taxels)) * 1e3,
        "cones": rows,
    }
