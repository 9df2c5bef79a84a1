"""Finds the table of taxel positions that skinManager used when a contact list was recorded.

For each contact, the log contains the taxels and the mean of their positions in this table (the geometric
centre). In another table, the mean of the same taxels is different.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tci.errors import DescriptionError
from tci.messages.frames import Array
from tci.recording.icub_links import link_frame
from tci.recording.skin_manager import SKIN_PARTS, SkinContact
from tci.robot.description import Robot, Table
from tci.robot.skin_files.reader import read_layout
from tci.skin.surfaces import Surface

NEAR = 1e-3
"""Largest distance [m] at which a recorded centre agrees with a table. Assumed: tables are rounded to 0.5 mm,
and tables of two versions of an iCub's forearm differ by 2 mm or more (median)."""
MOST = 0.9
"""Least fraction of the contacts that must agree with a table. Assumed: 98 % of the contacts agree with
the right table of an iCub's hand, and 27 % with the table of the other hand; this value is between them."""
PLACES = 10
"""Least number of different recorded centres from which the rigid motion between the robot's taxels and the
recorded table is estimated. Assumed: ten centres are enough, since they have 30 coordinates, and a rigid
motion has only six parameters."""

Verdict = Literal["fits", "wrong", "unknown", "no patch"]


@dataclass(frozen=True, slots=True)
class TableFit:
    """Comparison of the contacts recorded on one part with the skin of a robot, and with given tables of
    taxel positions."""

    part: str
    """Name of the skin part."""
    contacts: int
    """Number of contacts recorded on this part."""
    off: float
    """Median distance [m] between the recorded centres and the centres that are computed from the robot's
    taxels. The value is NaN if this distance is unknown."""
    verdict: Verdict
    """Result of the comparison with the robot's skin:

    - `fits`, `wrong`: the robot's taxels are, or are not, at the recorded places.
    - `unknown`: no comparison, since each contact contains a taxel that the robot's patch lacks, or no taxel.
    - `no patch`: the robot has no patch with the part's name."""
    tables: tuple[str, ...]
    """Names of the given tables that agree with the recorded contacts. Tables of two versions of a skin may
    both agree."""


def read_tables(folder: Path) -> dict[str, Array]:
    """Returns the positions (n, 3) [m] of each skin file (.txt, .csv) in a folder, by file name."""
    return dict(_tables(folder))


def compare_tables(
    contacts: Iterable[SkinContact], robot: Robot, surfaces: dict[str, Surface], tables: dict[str, Array]
) -> list[TableFit]:
    """Compares all contacts of a recording with a robot's `surfaces` (by patch name) and with `tables`."""
    recorded: dict[str, list[SkinContact]] = {}
    for contact in contacts:
        recorded.setdefault(SKIN_PARTS[contact.skin_part], []).append(contact)
    found = []
    for part, own in recorded.items():
        centres = np.array([contact.geometric_centre for contact in own])
        taxels = [contact.taxels for contact in own]
        fitting = [
            name for name, positions in tables.items()
            if _agree(_off(centres, taxels, positions), of=len(own))
        ]  # fmt: skip
        off: Array = np.empty(0)
        verdict: Verdict = "no patch"
        if part in surfaces:
            off = _off_skin(centres, taxels, _own_table(robot, surfaces[part]))
            verdict = "unknown" if not len(off) else "fits" if _agree(off, of=len(off)) else "wrong"
        median = float(np.median(off)) if len(off) else float("nan")
        found.append(TableFit(part, len(own), median, verdict, tuple(fitting)))
    return found


def _tables(folder: Path) -> Iterator[tuple[str, Array]]:
    for path in sorted(folder.iterdir()):
        if path.suffix in (".txt", ".csv"):
            try:
                yield path.name, read_layout(path).positions
            except (DescriptionError, OSError):
                continue  # this file is not a skin file


def _own_table(robot: Robot, surface: Surface) -> Array:
    """Returns the positions (n, 3) [m] of the n channels of a patch.

    If the description refers to a file of positions for this patch, returns the positions in this file, in
    which channels without a taxel are at 0, as in skinManager. For other patches the positions are in the
    frame of iDyn's link or, if this frame is unknown, of the robot's link; channels without a taxel are NaN.
    """
    description = robot.patch(surface.patch)
    if isinstance(description.surface, Table):
        table = description.surface
        path = Path(robot.source).parent / table.file
        return read_layout(path, form=table.format, sensor=table.sensor).positions
    positions = np.full((description.channels, 3), np.nan)
    T_LD = link_frame(robot, surface.patch)
    positions[surface.channels] = (
        surface.positions if T_LD is None else ((surface.positions - T_LD[:3, 3]) @ T_LD[:3, :3])
    )
    return positions


def _means(taxels: list[NDArray[np.intp]], positions: Array) -> Array:
    """Returns the mean position (k, 3) [m] of the taxels of each of k contacts; `positions` (n, 3) [m] are
    those of all channels.

    The mean is NaN if a contact has no taxel, or a taxel without a position.
    """
    last = len(positions)
    placed = np.vstack([positions, np.full((1, 3), np.nan)])
    return np.array([placed[np.minimum(own, last) if len(own) else [last]].mean(axis=0) for own in taxels])


def _off(centres: Array, taxels: list[NDArray[np.intp]], positions: Array) -> Array:
    """Returns the distances [m] between the recorded `centres` (k, 3) [m] of k contacts and the mean
    positions of the contacts' `taxels`.

    `positions` (n, 3) [m] are the positions of all channels in the table that is tried. Contacts whose mean
    position is unknown are left out.
    """
    away: Array = np.linalg.norm(_means(taxels, positions) - centres, axis=1)
    return away[np.isfinite(away)]


def _off_skin(centres: Array, taxels: list[NDArray[np.intp]], positions: Array) -> Array:
    """Returns the distances [m] between the recorded `centres` (k, 3) [m] of k contacts and the mean
    positions of the contacts' `taxels`, computed from the `positions` (n, 3) [m] of all channels.

    If these distances are large, all mean positions are first rotated and moved together so that they fit the
    centres, because the frame in a description may differ from the frame in the recorded table.
    """
    means = _means(taxels, positions)
    known = np.isfinite(means).all(axis=1)
    here, there = means[known], centres[known]
    off: Array = np.linalg.norm(here - there, axis=1)
    if not len(off) or _agree(off, of=len(off)) or len(np.unique(there.round(4), axis=0)) < PLACES:
        return off
    near = np.ones(len(off), dtype=bool)
    for _ in range(5):
        middle, target = here[near].mean(axis=0), there[near].mean(axis=0)
        turn, _ = Rotation.align_vectors(there[near] - target, here[near] - middle)
        off = np.linalg.norm(turn.apply(here - middle) + target - there, axis=1)
        near = off <= np.quantile(off, MOST)
    return off


def _agree(off: Array, *, of: int) -> bool:
    return len(off) > 0 and int((off <= NEAR).sum()) >= MOST * of
