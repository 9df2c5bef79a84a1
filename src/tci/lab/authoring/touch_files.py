"""Reads files of touches at known places, and writes files of taxels that were located by these touches."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tci.errors import CommandError
from tci.lab.authoring.locate_taxels import LocatedTaxels, ProbeTouch
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface

PLACE = 6
"""Number of columns before the raw values of a touch: x y z [m] and the outward normal."""


def read_touches(path: Path, robot: Robot, surface: Surface) -> list[ProbeTouch]:
    """Reads touches from a CSV file with one touch per row.

    A row contains the place x, y, z [m] and the outward normal nx, ny, nz in the patch's link, then the raw
    frame. Raises CommandError for a file that does not fit the patch.
    """
    patch = robot.patch(surface.patch)
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as error:
        raise CommandError(
            f"{path}: {str(error).rstrip('.')}; valid: rows of numbers separated by commas, no header"
        ) from error
    if rows.shape[1] != PLACE + patch.channels:
        raise CommandError(
            f"{path}: {rows.shape[1]} numbers in a row; valid: {PLACE + patch.channels}, x y z nx ny nz "
            f"and the {patch.channels} channels of {patch.name}"
        )
    sensor = patch.sensor
    counts = (rows[:, PLACE:] - sensor.rest) * np.sign(sensor.pascal_per_count)
    pressure = sensor.pressure(np.maximum(counts[:, normal_channels(patch, surface)] - 1.0, 0.0))
    normals = rows[:, 3:PLACE] / np.maximum(np.linalg.norm(rows[:, 3:PLACE], axis=1, keepdims=True), 1e-9)
    return [ProbeTouch(p, n, a) for p, n, a in zip(rows[:, :3], normals, pressure, strict=True)]


def write_taxels(path: Path, surface: Surface, located: LocatedTaxels) -> None:
    """Writes the taxels as a skin table. A taxel that was never touched keeps its present normal."""
    lines = ["channel, x [mm], y [mm], z [mm], nx, ny, nz"]
    normals: Array = np.where(located.touches[:, None] > 0, located.normals, surface.normals)
    for channel, place, normal in zip(surface.channels, located.positions, normals, strict=True):
        numbers = [f"{1e3 * value:.3f}" for value in place] + [f"{value:.5f}" for value in normal]
        lines.append(", ".join([str(channel), *numbers]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
