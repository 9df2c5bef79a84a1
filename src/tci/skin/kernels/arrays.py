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
"""Columns of `LayoutArrays.begin`."""
LOWEST, HIGHEST, REST, SIGN, FULL = range(5)
"""Columns of `LayoutArrays.sensor`: range, rest value and polarity of raw values, largest deviation
[counts]."""
FIRST, END, STRAIGHT = range(3)
"""Columns of `LayoutArrays.span`."""
AREA = 6
"""Column of `LayoutArrays.taxel` after position and normal."""
LINK, LIMB_LINK, POSTURE = range(3)
"""Columns of `LayoutArrays.on`."""
BLOCK_SIZE = 64
"""Taxels per block. If the raw values of a block equal those of the previous frame, the frame is only counted
for this block."""


class LayoutArrays(NamedTuple):
    """Constant properties of all taxels (n,) of a robot, in the order of patches (p,)."""

    begin: Places
    """First taxel, channel, block, cell and node (p + 1, 5) of each patch."""
    sensor: Single
    """Range, rest value, polarity and largest deviation (p, 5) [counts]."""
    rate: Array
    """Frames per second (p,) [Hz]."""
    channel: Places
    """Index (n,) of each taxel in the buffer of raw values."""
    span: Places
    """First channel, last + 1, and 1 if the channels are consecutive (b, 3), of each block."""
    gain: Array
    """Response (n,) [Pa per count]; for a response that `nodes` define, a factor of it."""
    nodes: Array
    """Deviation [counts] and pressure [Pa] (2, m) at the nodes of piecewise linear responses."""
    taxel: Array
    """Position [m], normal and area [m2] (n, 7), in the patch's link."""
    fill: Array
    """Fill factor (n, w) around each taxel, at each of `fill_factor.WIDTHS`."""
    graph: Indices
    """Start of each taxel's neighbours (n + 1 entries), followed by the neighbours."""
    faces: Indices
    """Corners (f, 3) of each face."""
    box: Array
    """Least corner (3,) [m] of each patch's grid of cells, cells per metre, number of cells along x, y, z (p,
    7)."""
    cells: Indices
    """Start of each cell's faces (cells + 1 entries), followed by the faces that overlap each cell."""
    limb: Array
    """Segment of each patch (p, 15), see `limb_numbers`; zeros for none."""
    on: Places
    """Index (p, 3) of the patch's link, of its segment's link and of its part's posture."""


class Estimates(NamedTuple):
    """Properties of each taxel (n,) that are estimated at run time."""

    offset: Single
    """Rest value [counts], relative to the description's."""
    threshold: Single
    """Deviation [counts] above which a taxel is active."""
    muted: NDArray[np.bool_]
    """Taxels whose values are ignored."""
    least: Array
    """Pressure [Pa] above which a taxel is active; infinite if it is masked."""
    fluctuating: NDArray[np.bool_]
    """Taxels so noisy that their values never stay constant for long."""
    onset: Array
    """Pressure [Pa] of two counts, at which a light touch begins; infinite while the noise is unknown."""
    hidden: Array
    """Pressure [Pa] below which the edge of a touch is not measured; 0 for sheets and switches, on which a
    touch has no gradual edge."""


class SkinMemory(NamedTuple):
    """Statistics of the current estimation windows, and the data for computing them."""

    statistics: Single
    """Per taxel (6, n), see `kernels.condition`."""
    blocks: Indices
    """Per block (b, 4), see `kernels.condition`."""
    patches: Array
    """Per patch (p, 9), see `kernels.condition`."""
    smoothed: Array
    """Filtered pressure (n,) [Pa] of the previous frame; (0,) without smoothing."""
    room: Single
    """Work space for the raw values of one block."""
    counts: Places
    """Number of active taxels (p,) of each patch."""
    active: Indices
    """Indices (n,) of active taxels within their patch. Those of a patch begin at the index of its first
    taxel."""
    pressure: Array
    """Pressures (n,) [Pa] of the active taxels, in the same order."""


class ActiveTaxels(NamedTuple):
    """The arrays of a `SkinState`."""

    stamp: Array
    begin: Places
    active: Indices
    pressure: Array


class Limits(NamedTuple):
    """Least forces [N] on taxels, see `ContactSettings`."""

    floor: float
    light: float
    touch: float


class Clusters(NamedTuple):
    """Clusters of neighbouring taxels, patch by patch, in the order of their first taxels."""

    force: Array
    """Work space (n,), zero between two frames."""
    label: Indices
    """Work space (n,), zero between two frames."""
    queue: Indices
    """Work space (n,)."""
    counts: Places
    """Number of clusters (p,) on each patch."""
    bound: Indices
    """Start of each cluster's members (n + 1,)."""
    member: Indices
    """Members (n,) of all clusters, as indices of taxels within the whole skin, in increasing order within
    each cluster."""
    member_force: Array
    """Force (n,) [N] on each member."""


class ContactArrays(NamedTuple):
    """The arrays of `Contacts`; shapes and units are given there."""

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
"""Numba types of these tuples; fields without another type are `float64`."""
