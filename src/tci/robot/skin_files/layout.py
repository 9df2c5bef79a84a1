"""The skin layout that every reader returns: the position of each channel of a patch and its properties.

A patch has modules and a module has taxels. The rows here are the channels of a raw frame, so thermal pads,
channels without a position and taxels all keep their number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tci.frames import Array, apply, read_only
from tci.robot.skin_files.normals import DISAGREE, disagreement, estimate_normals


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """One patch of skin: n channels, in the frame of the file that was read.

    The file does not name that frame. `moved` transforms the layout into the frame of a link.
    """

    source: str
    """Path of the file that was read."""
    name: str
    """Name of the skin in the file, for example `l_forearm`; empty if there is none."""
    positions: Array
    """Positions (n, 3) [m]; zero if unknown."""
    normals: Array
    """Outward unit normals (n, 3); zero without a position, or if none could be estimated."""
    estimated: NDArray[np.bool_]
    """True for normals (n,) that were estimated, since the file lacks them, has a placeholder, or wrong
    ones."""
    areas: Array
    """Area (n,) [m2] that each channel represents; zero without a position."""
    valid: NDArray[np.bool_]
    """True for channels (n,) that have a position. Thermal pads may be among them."""
    pads: NDArray[np.bool_]
    """True for channels (n,) that are thermal pads, which measure no pressure."""
    modules: NDArray[np.intp]
    """Module (n,) of each channel; -1 for a channel that has no position and is not a pad."""
    representative: NDArray[np.intp]
    """Channel (n,) that represents each channel if a skin is read per triangle; -1 absent, -2 pad."""
    listed_normals: Array
    """Normals (n, 3) as in the file, not always of unit length: skinManager uses them unchanged."""
    tangents: Array | None = None
    """Unit x axes (n, 3) of three-axis taxels, perpendicular to the normals; None if the file has none."""
    sampling: Literal["taxel", "triangle"] = "taxel"
    """Meaning of a position: that of one taxel, or one for all taxels with the same representative."""
    note: str = ""
    """Contradiction in the file, and how it was resolved; empty for none."""

    @property
    def channels(self) -> int:
        """Number of values n in a frame of this skin."""
        return len(self.positions)

    @property
    def taxels(self) -> NDArray[np.intp]:
        """Channels that are taxels with a position: the valid ones without the pads."""
        return np.flatnonzero(self.valid & ~self.pads)

    def moved(self, T_LF: Array) -> SkinLayout:
        """Returns this skin in the frame of the link L, from the pose `T_LF` (4, 4) of the file's frame F."""
        rotation = T_LF[:3, :3]
        return replace(
            self,
            positions=read_only(np.where(self.valid[:, None], apply(T_LF, self.positions), 0.0)),
            normals=read_only(self.normals @ rotation.T),
            listed_normals=read_only(self.listed_normals @ rotation.T),
            tangents=None if self.tangents is None else read_only(self.tangents @ rotation.T),
        )


def make_layout(
    source: str,
    positions: Array,
    normals: Array,
    valid: NDArray[np.bool_],
    *,
    name: str = "",
    estimated: NDArray[np.bool_] | None = None,
    areas: Array | None = None,
    pads: NDArray[np.bool_] | None = None,
    modules: NDArray[np.intp] | None = None,
    representative: NDArray[np.intp] | None = None,
    tangents: Array | None = None,
    sampling: Literal["taxel", "triangle"] = "taxel",
) -> SkinLayout:
    """Makes a layout from the data of a reader: n `positions` (n, 3) [m] and `normals` (n, 3) of any length.

    Normals are scaled to unit length. Normals marked by `estimated` (n,), and those of zero length, are
    estimated from neighbouring taxels. If the normals do not fit the positions, all are estimated, and `note`
    reports this. A missing area is that of a hexagon computed from the distance to the nearest neighbour
    (assumed: taxels on a triangular lattice). Without `modules` all channels are one module; without
    `representative` each taxel represents itself. `tangents` (n, 3) are x axes of any length.
    """
    n = len(positions)
    pads = np.zeros(n, dtype=bool) if pads is None else pads
    lengths = np.linalg.norm(normals, axis=1)
    guessed = valid & (lengths < 1e-3)
    if estimated is not None:
        guessed |= valid & estimated
    unit, note = np.zeros((n, 3)), ""
    known = valid & ~guessed
    off = disagreement(positions[known], normals[known] / lengths[known, None])
    if off > DISAGREE:
        guessed, known = valid.copy(), np.zeros(n, dtype=bool)
        note = (
            f"{Path(source).name}: the listed normals are {np.degrees(off):.0f} degrees off the planes "
            f"through their neighbours (median; valid: up to {np.degrees(DISAGREE):.0f}); they are estimated "
            "from the positions instead"
        )
    unit[known] = normals[known] / lengths[known, None]
    if guessed.any():
        guess = np.zeros((n, 3))
        guess[valid] = estimate_normals(positions[valid])
        unit[guessed] = guess[guessed]
    if areas is None:
        areas = hexagons(positions, valid & ~pads)
    present = valid | pads
    modules = np.zeros(n, dtype=np.intp) if modules is None else modules
    if representative is None:
        representative = np.where(pads, -2, np.where(valid, np.arange(n), -1))
    return SkinLayout(
        source=source,
        name=name,
        positions=read_only(np.where(valid[:, None], positions, 0.0)),
        normals=read_only(unit),
        estimated=read_only(guessed, np.bool_),
        areas=read_only(np.where(valid, areas, 0.0)),
        valid=read_only(valid, np.bool_),
        pads=read_only(pads, np.bool_),
        modules=read_only(np.where(present, modules, -1), np.intp),
        representative=read_only(representative, np.intp),
        listed_normals=read_only(normals),
        tangents=None if tangents is None else read_only(_across(tangents, unit)),
        sampling=sampling,
        note=note,
    )


def _across(tangents: Array, normals: Array) -> Array:
    """Projects the directions perpendicular to the normals and scales them to unit length; zero if
    impossible."""
    along = tangents - np.einsum("ni,ni->n", tangents, normals)[:, None] * normals
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    result: Array = np.divide(along, lengths, out=np.zeros_like(along), where=lengths > 1e-6)
    return result


def hexagons(positions: Array, taxels: NDArray[np.bool_]) -> Array:
    """Returns the area (n,) [m2] of the hexagon around each of `taxels` (n,), from the distance to the
    nearest other one."""
    areas = np.zeros(len(positions))
    places = np.unique(positions[taxels], axis=0)
    if len(places) > 1:
        spacing = cKDTree(places).query(positions[taxels], k=2)[0][:, 1]
        areas[taxels] = np.sqrt(0.75) * spacing**2
    return areas
