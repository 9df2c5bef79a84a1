"""A robot with one patch of 64 taxels on its right forearm, and no other skin."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

import tci

PITCH = 0.006
"""Distance [m] of neighbouring taxels."""
RADIUS = 0.04
"""Radius [m] of the forearm under the patch: the outside of NAO's."""


def write_one_patch(folder: Path) -> Path:
    """Writes the robot into `folder`, and returns the path of its description."""
    source = Path(tci.load_robot("nao-plain-h21").source).parent
    shutil.copytree(source, folder, dirs_exist_ok=True)
    rows = ["channel, x [mm], y [mm], z [mm], nx, ny, nz, area [mm2]"]
    grid = PITCH * (np.arange(8) - 3.5)
    for number, (along, around) in enumerate((a, b) for a in grid for b in grid):
        angle = around / RADIUS
        outward = np.array([0.0, -np.cos(angle), np.sin(angle)])
        x, y, z = 1e3 * (np.array([0.06 + along, 0.0, 0.0]) + RADIUS * outward)
        rows.append(f"{number}, {x:.3f}, {y:.3f}, {z:.3f}, 0, {outward[1]:.6f}, {outward[2]:.6f}, 36")
    (folder / "patch.csv").write_text("\n".join(rows) + "\n")
    gone = "".join(
        f'<patch name="{patch.name}" removed="yes"/>' for patch in tci.load_robot("nao-plain-h21").patches
    )
    path = folder / "one-patch.xml"
    path.write_text(
        '<generic_robot version="1" extends="plain-h21.xml" name="one-patch" angle_unit="deg">'
        f"<skin>{gone}"
        '<patch name="patch" part="right_arm" segment="forearm" link="RForeArm" rate="100" channels="64">'
        '<sensor rest="240" pascal_per_count="-420" min="0" max="255"/>'
        '<table format="csv" file="patch.csv"/></patch></skin>'
        '<binding middleware="naoqi" removed="yes"/></generic_robot>'
    )
    return path
