"""Real skin files beside the checkout, and small ones written here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parent.parent.parent / "shared" / "data"
FOLDERS = ("icub/positions", "icub/positions_pycub", "nao/positions")


def real_file(name: str) -> Path:
    """A real file by its path under the data, or a skip that names it."""
    if not (DATA / name).is_file():
        pytest.skip(f"did not run: {name} is not on this machine (valid: a folder shared/data beside it)")
    return DATA / name


def cone_file(path: Path, *, normals: str = "1 0 0", modules: int = 16) -> Path:
    """Write a skin of `modules` on a cone about z: radius 40 mm at z = 0, 30 mm at z = 100 mm."""
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
