"""Arrays that the stages of perception share: layout, estimates, memory and results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, float64, int32, int64
from numpy.typing import NDArray

from tci.compiled import reads, record, writes
from tci.frames import Array

Indices = NDArray[np.int32]
Places = NDArray[np.int64]
Single = NDArray[np.float32]

TAXEL, CHANNEL, BLOCK, CELL, NODE = range(5)
"""Columns of `LayoutArrays.begin`: a patch's first taxel, channel, block of taxels, cell of the grid over its
faces, and node of its response."""
LOWEST, HIGHEST, REST, SIGN, FULL = range(5)
"""Columns of `LayoutArrays.sensor`: the range (two columns), rest value and polarity of raw values, and the
largest deviation [counts]."""
FIRST, END, STRAIGHT = range(3)
"""Columns of `LayoutArrays.span`, for one block of a patch's taxels: smallest channel, largest channel + 1,
and 1 if the channels of successive taxels are consecutive, otherwise 0."""
AREA = 6
"""Column of `LayoutArrays.taxel` with the area, after the columns of position and normal."""
LINK, LIMB_LINK, POSTURE = range(3)
"""Columns of `LayoutArrays.on`, which has one row per patch: link of the patch, link of the patch's limb
segment, and the row that contains the angles of the patch's generic part."""
BLOCK_SIZE = 64
"""Taxels per block. If the raw values of a block equal those of the previous frame, the block is not computed
again: only the number of such frames is counted."""


class LayoutArrays(NamedTuple):
    """Constant properties of all taxels (n,) of a robot, in the order of patches (p,)."""

    begin: Places
    """First taxel, channel, block of taxels, grid cell and response node of each patch, as indices (p + 1, 5)
    into the arrays of the whole skin. The last row contains the totals."""
    sensor: Single
    """Lowest and highest value, rest value, polarity and largest deviation (p, 5) [counts] of each patch's
    sensor."""
    rate: Array
    """Frames per second (p,) [Hz]."""
    channel: Places
    """Index (n,) of each taxel in the buffer of raw values."""
    span: Places
    """Table (b, 3) with a row for each block of taxels: first channel, last channel + 1, and 1 if the
    channels are consecutive, otherwise 0."""
    gain: Array
    """Response (n,) [Pa per count] of each taxel. For a patch with a response curve (see `nodes`): factor by
    which the taxel's pressure on the curve is multiplied."""
    nodes: Array
    """Deviation [counts] and pressure [Pa] (2, m) at the nodes of piecewise linear responses."""
    taxel: Array
    """Position [m], outward normal and area [m2] (n, 7) of each taxel, in the frame of the patch's link."""
    fill: Array
    """Fill factor (n, w) around each taxel, for each width in `fill_factor.WIDTHS`."""
    graph: Indices
    """Neighbours of each taxel: the neighbours of taxel i are the entries from `graph[i]` to `graph[i + 1]` -
    1 of this array.
    """
    faces: Indices
    """Indices (f, 3) of the three taxels at the corners of each of the f faces."""
    box: Array
    """Grid of cells (p, 7) of each patch: the corner (3,) [m] with the lowest coordinates, the number of
    cells per metre, and the number of cells along x, y and z."""
    cells: Indices
    """Index at which the faces of each grid cell (see `box`) start in this array (cells + 1 entries),
    followed by the faces, cell by cell."""
    limb: Array
    """Properties (p, 15) of each patch's limb segment: rotation of the mount (9 numbers), origin (3), length,
    side, and index of the segment. Zeros for a patch that is on no limb segment.
    """
    on: Places
    """Indices (p, 3) of the patch's link, of the link of its limb segment, and of its part's row in the
    posture."""


class Estimates(NamedTuple):
    """Properties of each taxel (n,) that are estimated at run time."""

    offset: Single
    """Rest value [counts], relative to the rest value in the description."""
    threshold: Single
    """Deviation [counts] above which a taxel is active."""
    muted: NDArray[np.bool_]
    """True for taxels whose values are ignored."""
    least: Array
    """Pressure [Pa] above which a taxel is active. The value is infinite if the taxel is masked."""
    fluctuating: NDArray[np.bool_]
    """True for taxels with so much noise that their values never stay constant for long."""
    onset: Array
    """Pressure [Pa] that corresponds to a deviation of two counts. A light touch begins at this pressure. The
    value is infinite while the taxel's noise is unknown."""
    hidden: Array
    """Pressure [Pa] below which the edge of a touch is not measured. The value is 0 for taxels on which a
    touch has no gradual edge, such as switches and the taxels of a palm or a sole."""


class SkinMemory(NamedTuple):
    """Statistics of the current estimation windows, and the data from which they are computed."""

    statistics: Single
    """Rows (6, n) with one value per taxel: the present signal [counts], the signal before it, and, since the
    window began, the sum of signals, the largest deviation, the sum of absolute second differences, and the
    number of changes."""
    blocks: Indices
    """Four values (b, 4) for each block of up to 64 taxels: counts of repeated frames and of saturated
    taxels, and two flags. `kernels.condition` explains the columns."""
    patches: Array
    """State (p, 9) of each patch's estimation window, such as its length and number of frames.
    `kernels.condition` explains the columns."""
    smoothed: Array
    """Filtered pressure (n,) [Pa] of the previous frame. The shape is (0,) if pressures are not filtered."""
    room: Single
    """Work space for one number per taxel of a block."""
    counts: Places
    """Number of active taxels (p,) of each patch."""
    active: Indices
    """Active taxels (n,), as indices within their patch. The list of each patch begins at the place of the
    patch's first taxel in the whole skin."""
    pressure: Array
    """Pressures (n,) [Pa] of the active taxels, in the order of `active`."""


class ActiveTaxels(NamedTuple):
    """The arrays of a `SkinState` that the compiled loops need. `SkinState` describes them."""

    stamp: Array
    begin: Places
    active: Indices
    pressure: Array


class Limits(NamedTuple):
    """Least forces [N] on taxels for a contact, see `ContactSettings`."""

    floor: float
    light: float
    touch: float


class Clusters(NamedTuple):
    """Clusters of neighbouring active taxels, patch by patch.

    Clusters on one patch are ordered by their first taxels.
    """

    force: Array
    """Scratch memory (n,) for the force on each taxel [N]. All its values are zero between two frames."""
    label: Indices
    """Scratch memory (n,) for the cluster of each taxel. All its values are zero between two frames."""
    queue: Indices
    """Scratch memory (n,) for the taxels of all clusters, in the order in which the search reaches them."""
    counts: Places
    """Number of clusters (p,) on each patch."""
    bound: Indices
    """Index (n + 1,) in `member` of each cluster's first taxel. The entry after the last cluster is the
    number of taxels in all clusters."""
    member: Indices
    """Taxels (n,) of all clusters, as indices within the whole skin. Within each cluster the indices
    increase."""
    member_force: Array
    """Force (n,) [N] on each taxel in `member`."""


class ContactArrays(NamedTuple):
    """The arrays of `Contacts`. `Contacts` describes their shapes and units."""

    site: Places
    identity: Places
    onset: Array
    displacement: Array
    force: Array
    peak: Array
    area: Array
    p_L: Array
    n_L: Array
    p_T: Array
    n_T: Array
    f_T: Array
    u: Array
    theta: Array
    limb_point: Array
    begin: Places
    taxel: Places
    taxel_force: Array
    taxel_point: Array


LAYOUT = record(
    LayoutArrays, reads(2, int64), reads(2, float32), reads(1), reads(1, int64), reads(2, int64), reads(1),
    reads(2), reads(2), reads(2), reads(1, int32), reads(2, int32), reads(2), reads(1, int32), reads(2),
    reads(2, int64),
)  # fmt: skip
ESTIMATES = record(
    Estimates, writes(1, float32), writes(1, float32), writes(1, boolean), writes(1), writes(1, boolean),
    writes(1), writes(1),
)  # fmt: skip
MEMORY = record(
    SkinMemory, writes(2, float32), writes(2, int32), writes(2), writes(1), writes(1, float32),
    writes(1, int64), writes(1, int32), writes(1),
)  # fmt: skip
ROOM = record(ActiveTaxels, writes(1), writes(1, int64), writes(1, int32), writes(1))
ACTIVE = record(ActiveTaxels, reads(1), reads(1, int64), reads(1, int32), reads(1))
LIMITS = record(Limits, float64, float64, float64)
CLUSTERS = record(
    Clusters, writes(1), writes(1, int32), writes(1, int32), writes(1, int64), writes(1, int32),
    writes(1, int32), writes(1),
)  # fmt: skip
_C, _V = writes(1), writes(2)
CONTACTS = record(
    ContactArrays, writes(1, int64), writes(1, int64), _C, _C, _C, _C, _C, _V, _V, _V, _V, _V, _C, _C, _V,
    writes(1, int64), writes(1, int64), _C, _V,
)  # fmt: skip
"""Numba types of the fields of the named tuples above. Arrays without a stated type contain `float64`."""
