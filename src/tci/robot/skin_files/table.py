"""Patches with taxels from a file of any known format."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.messages.frames import rotation_rpy, transform
from tci.robot.description import Patch, Robot, Table
from tci.robot.skin_files.layout import SkinLayout
from tci.robot.skin_files.reader import read_layout


def read_table(robot: Robot, patch: Patch, table: Table) -> SkinLayout:
    """Returns the skin of a patch, in the frame of the patch's link.

    Warns if the normals in the file do not fit the positions. Raises DescriptionError if the file has faults,
    or if its taxels have no normals or no area.
    """
    path = Path(robot.source).parent / table.file
    layout = read_layout(path, form=table.format, sensor=table.sensor)
    if layout.note:
        warnings.warn(f"patch {patch.name}: {layout.note}", stacklevel=2)
    if not layout.normals[layout.taxels].any(axis=1).all():
        message = f"patch {patch.name}: no normals, and too few places to estimate them; valid: nx, ny, nz"
        raise DescriptionError(str(path), [Fault(0, message)])
    if not layout.areas[layout.taxels].all():
        message = f"patch {patch.name}: a taxel alone has no area that could be guessed; valid: a column area"
        raise DescriptionError(str(path), [Fault(0, message)])
    return layout.moved(transform(rotation_rpy(*table.rpy), np.array(table.xyz)))
