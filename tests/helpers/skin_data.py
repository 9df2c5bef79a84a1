"""Folders of skin files and recordings, made or genuine, and small made skins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

FOLDERS = ("icub/positions", "icub/positions_pycub", "nao/positions")

T = TypeVar("T")


@dataclass(frozen=True)
class SkinData:
    """A folder that contains the folders in FOLDERS and `recordings`."""

    folder: Path
    genuine: bool
    """True for files from real robots, False for made files with the same names."""

    def file(self, name: str) -> Path:
        return self.folder / name

    def expect(self, *, made: T, genuine: T) -> T:
        """Returns the expected value for these files: `made` or `genuine`."""
        return genuine if self.genuine else made


def cone_file(path: Path, *, normals: str = "1 0 0", modules: int = 16) -> Path:
    """Writes a skin file of `modules` on a cone about z with a radius of 40 mm at z = 0 and 30 mm at z = 100
    mm."""
    rows = []
    for channel in range(12 * modules):
        if channel % 12 in (6, 10):
            rows.append("0 0 0 0 0 0")
            continue
        theta, z = 2.4 * channel, 0.1 * channel / (12 * modules - 1)
        radius = 0.04 - 0.1 * z
        x, y = radius * np.cos(theta), radius * np.sin(theta)
        rows.append(f"{x:.6f}\t{y:.6f} {z:.6f}  {normals}")
    path.write_text("name cone % a comment\nspatial_sampling taxel\n\n[calibration]\n" + "\n".join(rows))
    return path
