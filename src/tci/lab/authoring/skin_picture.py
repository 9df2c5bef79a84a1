"""The picture of `tci skin show`: every taxel of a skin on its unrolled map, with its number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tci.errors import TciError
from tci.exports.cone import ConeFit, cone_of
from tci.lab.authoring.skin_map import best_cone, flatten, unroll
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.kinematics import KinematicChain
from tci.robot.near_points import nearest
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import build_surface
from tci.skin.triangulation import is_sheet

NUMBER = 0.2
"""Distance [inches] of neighbouring taxels: a number of three digits is 0.15 wide."""
LEAST = np.array([1.2, 1.2])
"""Least width and height [inches] of a map, which a title needs."""
MOST = 9.0
"""Greatest width or height [inches] of a map. Only numbers of more crowded taxels overlap."""
EDGE = 0.25
"""Room [inches] for the outermost taxels."""
BESIDE, LEFT_BELOW = np.array([0.9, 1.25]), np.array([0.7, 0.5])
"""Width and height [inches] of what is beside a map (its numbers and title), and the part left and below."""
WIDTH = 16.0
"""Width [inches] of a row, unless one map is wider."""


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

    @property
    def radius(self) -> float:
        """Mean distance [mm] from the axis."""
        return float(self.depth.mean())

    @property
    def along_up(self) -> Array:
        """Vertical coordinate (n,) [mm] on the unrolled skin."""
        return self.up if self.flat else np.radians(self.up) * self.radius

    @property
    def extent(self) -> Array:
        """Width and height (2,) [mm] of the unrolled skin."""
        return np.array([np.ptp(self.across), np.ptp(self.along_up)])


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
        cone: ConeFit | None = None
        if robot.limb_segment(patch):
            cone = cone_of(robot, surface, kinematics)
        elif not is_sheet(surface.normals):
            cone = best_cone(surface.positions)
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
    """Writes one picture with a map for each skin, side by side in rows, the highest first. Each map has its
    own scale: neighbours are as far apart as their numbers need. Raises TciError if it can't be written."""
    found = sorted(found, key=lambda one: -round(one.extent[1] * _scale(one)))
    scales = [_scale(one) for one in found]
    sizes = [
        np.maximum(one.extent * scale, LEAST) + EDGE + BESIDE
        for one, scale in zip(found, scales, strict=True)
    ]
    places, whole = _in_rows(sizes)
    figure = Figure(figsize=tuple(whole), dpi=110)
    for one, scale, size, place in zip(found, scales, sizes, places, strict=True):
        inner = np.concatenate([place + LEFT_BELOW, size - BESIDE]) / np.tile(whole, 2)
        _draw_map(figure.add_axes(tuple(inner)), one, (size - BESIDE) / scale)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out)
    except (OSError, ValueError) as error:
        raise TciError(f"the picture {out} can't be written: {error}") from error


def _scale(one: Map) -> float:
    """Inches of paper per millimetre of skin."""
    points = np.unique(np.column_stack([one.across, one.along_up, np.zeros(len(one.up))]).round(3), axis=0)
    widest = float(one.extent.max())
    if len(points) < 2 or not widest > 0.0:
        return 1.0
    spacing = float(np.median(nearest(points, points, 2)[0][:, 1]))
    return min(max(NUMBER / spacing, float(LEAST.max()) / widest), MOST / widest)


def _in_rows(sizes: list[Array]) -> tuple[list[Array], Array]:
    """Lower left corners of maps of these sizes, in rows from the top, and the size of the picture [inches].
    A small map lies below the one before if that row is high enough."""
    places, left, top, bottom, high, widest = [], 0.0, 0.0, 0.0, 0.0, 0.0
    column = below = 0.0  # width of a row's last column, and how far its maps reach below `top`
    for width, height in (size.tolist() for size in sizes):
        if width <= column and below + height <= high:
            below += height
            places.append(np.array([left - column, top - below]))
            continue
        if left > 0.0 and left + width > WIDTH:
            left, top, high = 0.0, bottom, 0.0
        places.append(np.array([left, top - height]))
        left, column, below, high = left + width, width, height, max(high, height)
        bottom, widest = top - high, max(widest, left)
    return [place - [0.0, bottom] for place in places], np.array([widest, -bottom])


def _draw_map(axes: Axes, one: Map, shown: Array) -> None:
    axes.scatter(one.across, one.along_up, c=one.depth, s=150, cmap="viridis", alpha=0.45, linewidths=0)
    for channel, x, y in zip(one.channels, one.across, one.along_up, strict=True):
        axes.text(x, y, str(channel), ha="center", va="center", fontsize=6)
    middle = np.array([np.ptp(values) / 2.0 + values.min() for values in (one.across, one.along_up)])
    axes.set_xlim(middle[0] - shown[0] / 2.0, middle[0] + shown[0] / 2.0)
    axes.set_ylim(middle[1] - shown[1] / 2.0, middle[1] + shown[1] / 2.0)
    axes.tick_params(labelsize=6)
    axes.locator_params(nbins=4)
    depth = "" if one.flat else f"\n{one.depth.min():.0f} to {one.depth.max():.0f} mm from the axis"
    axes.set_title(f"{one.title}\n{len(one.channels)} taxels{depth}", fontsize=8)
    axes.set_xlabel(f"x along the {'skin' if one.flat else 'limb'} [mm]", fontsize=7)
    axes.set_ylabel("y [mm]" if one.flat else "theta around the limb [deg]", fontsize=7)
    if not one.flat:
        turns = np.arange(-180, 181, 45)
        axes.set_yticks(np.radians(turns) * one.radius, [str(turn) for turn in turns])
    axes.grid(alpha=0.3)
