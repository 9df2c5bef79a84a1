"""The picture of `tci skin show`: every taxel of a skin on its unrolled map, with its number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tci.errors import TciError
from tci.exports.cone import ConeFit, cone_of
from tci.lab.authoring.skin_map import best_cone, flatten, unroll
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface


@dataclass(frozen=True)
class Map:
    """Unrolled map of one skin."""

    title: str
    channels: NDArray[np.intp]
    """Channel (n,) of each taxel in the raw frame."""
    across: Array
    """Horizontal coordinate (n,): x [mm] along the limb."""
    up: Array
    """Vertical coordinate (n,): theta [deg] around the limb, or y [mm] for a flat skin."""
    flat: bool
    depth: Array
    """Distance (n,) [mm] from the limb's axis; zero for a flat skin."""


def maps(skin: str) -> list[Map]:
    """Returns the map of a skin file, or the maps of all patches of a robot.

    Raises TciError for a file that can't be read, or a robot without skin.
    """
    path = Path(skin)
    if path.is_file() and path.suffix != ".xml":
        file = read_layout(path)
        positions = file.positions[file.taxels]
        return [_map(f"{path.name} ({file.name})", file.taxels, positions, best_cone(positions))]
    robot = load_robot(skin)
    if not robot.patches:
        raise TciError(
            f"{robot.name} has no skin to show; valid: a robot with skin (tci robots), or a skin file"
        )
    kinematics = KinematicChain(robot)
    result = []
    for patch in robot.patches:
        surface = build_surface(robot, patch, kinematics)
        cone = cone_of(robot, surface, kinematics) if robot.limb_segment(patch) else None
        result.append(_map(f"{robot.name} {patch.name}", surface.channels, surface.positions, cone))
    return result


def _map(title: str, channels: NDArray[np.intp], positions: Array, cone: ConeFit | None) -> Map:
    if cone is None:
        x, y = flatten(positions)
        return Map(title, channels, 1e3 * x, 1e3 * y, True, np.zeros(len(x)))
    x, theta = unroll(positions, cone)
    relative = positions - cone.origin
    distance = np.linalg.norm(relative - x[:, None] * cone.axis, axis=1)
    return Map(title, channels, 1e3 * x, np.degrees(theta), False, 1e3 * distance)


def draw(found: list[Map], out: Path) -> None:
    """Writes one picture with a map for each skin. Raises TciError if the file can't be written."""
    figure = Figure(figsize=(14.0, 8.0 * len(found)), dpi=110, layout="constrained")
    for axes, one in zip(figure.subplots(len(found), 1, squeeze=False)[:, 0], found, strict=True):
        dots = axes.scatter(one.across, one.up, c=one.depth, s=190, cmap="viridis", alpha=0.45, linewidths=0)
        for channel, x, y in zip(one.channels, one.across, one.up, strict=True):
            axes.text(x, y, str(channel), ha="center", va="center", fontsize=6)
        axes.set_title(f"{one.title}: {len(one.channels)} taxels, numbered by channel")
        axes.set_xlabel("x along the skin [mm]" if one.flat else "x along the limb [mm]")
        axes.set_ylabel("y [mm]" if one.flat else "theta around the limb [deg]")
        if one.flat:
            axes.set_aspect("equal")
        else:
            axes.set_ylim(-190.0, 190.0)
            axes.set_yticks(range(-180, 181, 45))
            figure.colorbar(dots, ax=axes, label="distance from the axis [mm]")
        axes.grid(alpha=0.3)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out)
    except (OSError, ValueError) as error:
        raise TciError(f"the picture {out} can't be written: {error}") from error
