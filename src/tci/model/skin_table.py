"""Patches whose taxels stand in a file: plain rows, or a skin calibration file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tci.errors import DescriptionError, Fault
from tci.frames import Array, rotation_rpy
from tci.model.description import Patch, Robot, Table
from tci.model.skin_file import MODULE_PITCH, read_skin_file


def read_table(robot: Robot, patch: Patch, table: Table) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Positions and normals in the patch's link, areas and channels from a file.

    Row i is channel i, all zeros: no taxel there. A taxel stands for the hexagon that its nearest
    neighbour leaves it (ours).
    """
    positions, normals, areas, channels = _in_the_files_frame(robot, patch, table)
    R_LF = rotation_rpy(*table.rpy)
    return positions @ R_LF.T + np.array(table.xyz), normals @ R_LF.T, areas, channels


def _in_the_files_frame(
    robot: Robot, patch: Patch, table: Table
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    path = Path(robot.source).parent / table.file
    if table.format == "icub":
        return _calibrated(patch, path)
    try:
        rows = np.loadtxt(path.read_text().replace(",", " ").splitlines(), comments=("#", "%"), ndmin=2)
    except (OSError, ValueError) as error:
        raise DescriptionError(str(path), [Fault(0, f"not a table of taxels: {error}")]) from error
    if rows.shape[1:] != (6,) or not np.isfinite(rows).all():
        raise DescriptionError(
            str(path), [Fault(0, "valid: six finite numbers in each row, x y z nx ny nz [m]")]
        )
    channels = np.flatnonzero(rows.any(axis=1))
    positions, normals = rows[channels, :3], rows[channels, 3:]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if len(channels) < 4 or not lengths.all():
        message = f"patch {patch.name}: valid: at least four taxels, each with a normal that is not zero"
        raise DescriptionError(str(path), [Fault(0, message)])
    spacing = cKDTree(positions).query(positions, k=2)[0][:, 1]
    return positions, normals / lengths, np.sqrt(0.75) * spacing**2, channels


def _calibrated(patch: Patch, path: Path) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Positions, normals, areas and channels of the taxels in a skin calibration file."""
    skin = read_skin_file(path)
    channels = skin.taxels
    positions, normals = skin.positions[channels], skin.normals[channels]
    if len(np.unique(positions, axis=0)) < 4 or not normals.any(axis=1).all():
        message = f"patch {patch.name}: valid: at least four places, not all on one line"
        raise DescriptionError(str(path), [Fault(0, message)])
    # Some files round positions to a millimetre or repeat them; the module's own lattice is exact.
    areas = np.full(len(channels), np.sqrt(0.75) * MODULE_PITCH**2)
    return positions, normals, areas, channels
