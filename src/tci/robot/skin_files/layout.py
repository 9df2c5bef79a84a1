"""The skin model that every reader fills: where each channel of a patch is, and what is known of it.

A patch has modules and a module has taxels. The channels of a raw frame are the rows here, so that a
thermal pad, a channel without a position and a taxel all keep their number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tci.frames import Array, apply, read_only
from tci.robot.skin_files.normals import estimate_normals


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """One patch of skin: n channels, in the frame of the file that was read.

    A file's name does not tell that frame. `moved` brings it into the frame of a link.
    """

    source: str
    """The file that was read."""
    name: str
    """What the file calls itself, `l_forearm` for example; empty when it says nothing."""
    positions: Array
    """Positions (n, 3) [m]; zero where there is none."""
    normals: Array
    """Outward unit normals (n, 3); zero where there is no position, or none could be estimated."""
    estimated: NDArray[np.bool_]
    """Which normals (n,) the file lacks or has as a placeholder, so that they were estimated."""
    areas: Array
    """Area (n,) [m2] that each channel stands for; zero where there is no position."""
    valid: NDArray[np.bool_]
    """Which channels (n,) have a position. Thermal pads may be among them."""
    pads: NDArray[np.bool_]
    """Which channels (n,) are thermal pads and feel no touch."""
    modules: NDArray[np.intp]
    """Module (n,) that each channel belongs to; -1 where there is neither a position nor a pad."""
    representative: NDArray[np.intp]
    """The channel (n,) that stands for each when a skin is read per triangle; -1 absent, -2 pad."""
    listed_normals: Array
    """Normals (n, 3) as the file has them, not always of unit length: skinManager uses them so."""
    tangents: Array | None = None
    """Unit x axes (n, 3) across the normals, of three-axis taxels; None where the file has none."""
    sampling: Literal["taxel", "triangle"] = "taxel"
    """Whether a position is that of one taxel, or stands for all with the same representative."""

    @property
    def channels(self) -> int:
        """Values in a frame of this skin, n."""
        return len(self.positions)

    @property
    def taxels(self) -> NDArray[np.intp]:
        """The channels that are taxels with a place: valid ones without the pads."""
        return np.flatnonzero(self.valid & ~self.pads)

    def moved(self, T_LF: Array) -> SkinLayout:
        """The same skin in the link L, from its pose `T_LF` (4, 4) of the file's frame F."""
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
    """A layout from what a reader found: n `positions` (n, 3) [m] and `normals` (n, 3) of any length.

    Normals are made unit vectors. Those that `estimated` (n,) marks, and those of zero length, are
    estimated from the neighbours. Areas that are not given are the hexagon that the nearest neighbour
    leaves (ours). Without `modules` all is one module, without `representative` each taxel is its own.
    `tangents` (n, 3) are x axes of any length.
    """
    n = len(positions)
    pads = np.zeros(n, dtype=bool) if pads is None else pads
    lengths = np.linalg.norm(normals, axis=1)
    guessed = valid & (lengths < 1e-3)
    if estimated is not None:
        guessed |= valid & estimated
    unit = np.zeros((n, 3))
    known = valid & ~guessed
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
    )


def _across(tangents: Array, normals: Array) -> Array:
    """The same directions, made unit vectors across the normals; zero where they can't be."""
    along = tangents - np.einsum("ni,ni->n", tangents, normals)[:, None] * normals
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    result: Array = np.divide(along, lengths, out=np.zeros_like(along), where=lengths > 1e-6)
    return result


def hexagons(positions: Array, taxels: NDArray[np.bool_]) -> Array:
    """Area (n,) [m2] of the hexagon that the nearest of the other `taxels` (n,) leaves each of them."""
    areas = np.zeros(len(positions))
    places = np.unique(positions[taxels], axis=0)
    if len(places) > 1:
        spacing = cKDTree(places).query(positions[taxels], k=2)[0][:, 1]
        areas[taxels] = np.sqrt(0.75) * spacing**2
    return areas
