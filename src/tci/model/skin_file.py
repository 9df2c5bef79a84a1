"""Skin calibration files of iCub and NAO: where each taxel of a skin is.

A file has the words `name`, `spatial_sampling` and `taxel2Repr`, and then one row `x y z nx ny nz` [m]
for each channel of the skin's port, in the order of the port. Tabs, spaces, blank lines and comments
(`%`) may stand anywhere. The files of icub-main, robots-configuration and pyCub have quirks; what is
read from each is in docs/skin-files.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array, read_only
from tci.model.skin_normals import estimate_normals
from tci.model.skin_text import PER_MODULE, check_count, parse_lines, read_lines
from tci.model.xml_document import Faults

MODULE_PITCH = 6.534e-3
"""Distance [m] of neighbouring taxels on a triangular module, from pyCub's positions of iCub's skin."""
PADS_OF_MODULE = (6, 10)
"""Places on a module that are thermal pads, not taxels."""
PLACEHOLDER = (1.0, 0.0, 0.0)
"""The normal that CAD exports write where nobody measured one."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinFile:
    """A skin as its calibration file gives it: n channels, in the frame of the file.

    The file's name does not tell that frame. It is a link of the robot for most files and none for some.
    """

    source: str
    """The file that was read."""
    name: str
    """What the file calls itself, `l_forearm` for example; empty when it says nothing."""
    sampling: Literal["taxel", "triangle"]
    """Whether a position is that of one taxel, or stands for all with the same representative."""
    positions: Array
    """Positions (n, 3) [m]; zero where there is none."""
    normals: Array
    """Outward unit normals (n, 3); zero where there is no position."""
    listed_normals: Array
    """Normals (n, 3) as the file has them, not always of unit length: skinManager uses them so."""
    estimated: NDArray[np.bool_]
    """Which normals (n,) the file lacks or has as a placeholder, so that they were estimated."""
    valid: NDArray[np.bool_]
    """Which channels (n,) have a position. Thermal pads may be among them."""
    pads: NDArray[np.bool_]
    """Which channels (n,) are thermal pads and feel no touch."""
    representative: NDArray[np.intp]
    """The channel (n,) that stands for each when a skin is read per triangle; -1 absent, -2 pad."""

    @property
    def channels(self) -> int:
        """Values in a frame of this skin, n."""
        return len(self.positions)

    @property
    def taxels(self) -> NDArray[np.intp]:
        """The channels that are taxels with a place: valid ones without the pads."""
        return np.flatnonzero(self.valid & ~self.pads)


def read_skin_file(path: str | Path) -> SkinFile:
    """Read a skin calibration file.

    Raises DescriptionError with all faults, each with its line: numbers that are none, not finite or
    no metres, rows of other than six (or three) numbers, a count of rows that shows that some are
    missing, unknown words, and a file that is not text or too large.
    """
    source = str(path)
    faults = Faults(source)
    lines = read_lines(Path(path))
    text = parse_lines(lines, faults)
    faults.check()
    check_count(text, len(lines), faults)
    faults.check()
    rows = np.array(text.rows)
    n = len(rows)
    valid: NDArray[np.bool_] = np.any(rows[:, :3] != 0.0, axis=-1)
    # The list may be shorter or longer than the rows are many. Silence means nothing.
    listed = np.array((text.representative or [])[:n], dtype=np.intp)
    representative = np.full(n, -1, dtype=np.intp)
    representative[: len(listed)] = listed
    normals, estimated = _normals(rows, valid)
    return SkinFile(
        source=source,
        name=text.name,
        sampling=cast(Literal["taxel", "triangle"], text.sampling),
        positions=read_only(np.where(valid[:, None], rows[:, :3], 0.0)),
        normals=read_only(normals),
        listed_normals=read_only(rows[:, 3:]),
        estimated=read_only(estimated, np.bool_),
        valid=read_only(valid, np.bool_),
        pads=read_only(_pads(valid, listed), np.bool_),
        representative=read_only(representative, np.intp),
    )


def _pads(valid: NDArray[np.bool_], listed: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which channels (n,) are thermal pads.

    Newer files say -2. Older ones say -1 for a row that has a position, or nothing at all; then it is
    the two places that pads have on a module, on each module with a position.
    """
    pads = np.zeros(len(valid), dtype=bool)
    pads[: len(listed)] = (listed == -2) | ((listed == -1) & valid[: len(listed)])
    on_pad = np.isin(np.arange(len(valid)) % PER_MODULE, PADS_OF_MODULE)
    module = np.arange(len(valid)) // PER_MODULE
    on_pad &= np.isin(module, module[valid])
    silent = np.arange(len(valid)) >= (len(listed) if pads.any() else 0)
    return pads | (on_pad & silent)


def _normals(rows: Array, valid: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Unit normals (n, 3), and which of them (n,) are estimated.

    One module that truly faces +x is no placeholder, a skin that does everywhere is.
    """
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    placeholder = valid & (rows[:, 3:] == PLACEHOLDER).all(axis=1)
    estimated = valid & (lengths < 1e-3)
    if 2 * placeholder.sum() > valid.sum():
        estimated |= placeholder
    normals = np.zeros((len(rows), 3))
    known = valid & ~estimated
    normals[known] = rows[known, 3:] / lengths[known, None]
    if estimated.any():
        guess = np.zeros_like(normals)
        guess[valid] = estimate_normals(rows[valid, :3])
        normals[estimated] = guess[estimated]
    return normals, estimated
