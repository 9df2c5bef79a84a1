"""The skin layout that every reader returns: the position of each channel of a patch and its properties.

A patch has modules and a module has taxels. The rows of a layout are the channels of a raw frame. So taxels,
thermal pads and channels without a position all keep their channel numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, apply, read_only
from tci.robot.near_points import nearest
from tci.robot.skin_files.normals import DISAGREE, disagreement, estimate_normals


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """One patch of skin: n channels, in the frame of the file that was read.

    Skin files do not say to which link their frame belongs. `moved` transforms the layout into the frame of a
    link.
    """

    source: str
    """Path of the file that was read."""
    name: str
    """Name of the skin in the file, such as `l_forearm`; empty if the file contains no name."""
    positions: Array
    """Positions (n, 3) [m]; zero if unknown."""
    normals: Array
    """Outward unit normals (n, 3); zero for a channel without a position, or if no normal could be
    estimated."""
    estimated: NDArray[np.bool_]
    """True for channels (n,) with an estimated normal. A normal is estimated if it is missing in the file, is
    a placeholder, or is wrong."""
    areas: Array
    """Area (n,) [m2] of skin that each channel measures; zero for a channel without a position."""
    valid: NDArray[np.bool_]
    """True for channels (n,) that have a position. Some of these channels may be thermal pads."""
    pads: NDArray[np.bool_]
    """True for channels (n,) that are thermal pads, which measure no pressure."""
    modules: NDArray[np.intp]
    """Index (n,) of the module of each channel; -1 for a channel that has no position and is not a thermal
    pad."""
    representative: NDArray[np.intp]
    """For each channel, the index (n,) of the channel that represents it, possibly itself; -1 for an absent
    channel, -2 for a thermal pad. Older skin files have -1 for thermal pads too."""
    listed_normals: Array
    """Normals (n, 3) as written in the file. These normals may have any length. iCub's skinManager uses them
    unchanged."""
    tangents: Array | None = None
    """Unit x axes (n, 3) of three-axis taxels, perpendicular to the normals; None if the file contains no x
    axes."""
    sampling: Literal["taxel", "triangle"] = "taxel"
    """Meaning of a position. `taxel`: the position of one taxel. `triangle`: the common position of all
    taxels that have the same `representative`."""
    note: str = ""
    """Contradiction in the file, and the solution that the reader chose; empty if the file has no
    contradiction."""

    @property
    def channels(self) -> int:
        """Number of values n in a frame of this skin."""
        return len(self.positions)

    @property
    def taxels(self) -> NDArray[np.intp]:
        """Channels that are taxels with a position: all `valid` channels except thermal pads."""
        return np.flatnonzero(self.valid & ~self.pads)

    def moved(self, T_LF: Array) -> SkinLayout:
        """Returns this skin in the frame of the link L. `T_LF` (4, 4) is the pose of the file's frame F in
        L."""
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

    The layout contains normals of unit length. Normals marked by `estimated` (n,), and normals of zero
    length, are estimated from neighbouring taxels. If the normals differ too much from those of planes
    through neighbouring taxels, all normals are estimated, and the layout's `note` reports this. If `areas`
    is None, each area is that of a hexagon computed from the distance to the nearest neighbour (assumed:
    taxels are on a triangular lattice). If `modules` is None, all channels are one module. If
    `representative` is None, no channel stands for other channels. `tangents` (n, 3) are the x axes of
    three-axis taxels; they may have any length.
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
    """Returns the `tangents` (n, 3) made perpendicular to the `normals` (n, 3), with unit length. The result
    is zero for a tangent parallel to its normal."""
    along = tangents - np.einsum("ni,ni->n", tangents, normals)[:, None] * normals
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    result: Array = np.divide(along, lengths, out=np.zeros_like(along), where=lengths > 1e-6)
    return result


def hexagons(positions: Array, taxels: NDArray[np.bool_]) -> Array:
    """Returns, for each channel, the area (n,) [m2] of the hexagon around its taxel, computed from the
    distance to the nearest other taxel. The area is 0 if `taxels` (n,) is False for the channel, or if all
    taxels have one position."""
    areas = np.zeros(len(positions))
    places = np.unique(positions[taxels], axis=0)
    if len(places) > 1:
        spacing = nearest(places, positions[taxels], 2)[0][:, 1]
        areas[taxels] = np.sqrt(0.75) * spacing**2
    return areas
