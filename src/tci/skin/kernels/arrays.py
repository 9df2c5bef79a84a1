"""Arrays that the stages of perception share, grouped by who owns them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int32, int64
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
"""Taxels whose raw values are compared with those of the frame before, all at once."""


class LayoutArrays(NamedTuple):
    """All taxels (n,) of a robot, patch (p,) by patch. Nothing here ever changes."""

    begin: Places
    """Where each patch's taxels, channels, blocks, cells and nodes begin (p + 1, 5)."""
    sensor: Single
    """Range, rest, polarity and largest deviation (p, 5)."""
    rate: Array
    """Frames per second (p,) [Hz]."""
    channel: Places
    """Place (n,) of each taxel in the buffer of raw values."""
    span: Places
    """First channel, last + 1, and 1 if the channels are those between in order (b, 3), of each block."""
    gain: Array
    """Response (n,) [Pa per count]; 1 where `nodes` give it."""
    nodes: Array
    """Deviation [counts] and pressure [Pa] (2, m) between which the response is straight."""
    taxel: Array
    """Position [m], normal and area [m2] (n, 7), in the patch's link."""
    graph: Indices
    """Where the neighbours of each taxel begin, n + 1 places, and then the neighbours."""
    faces: Indices
    """Corners (f, 3) of each face."""
    box: Array
    """Least corner (3,) [m] of each patch's grid of cells, cells per metre, cells along x, y, z (p, 7)."""
    cells: Indices
    """Where the faces of each cell begin, cells + 1 places, and then the faces that reach into each."""
    limb: Array
    """The segment of each patch (p, 15), see `limb_numbers`; zeros for none."""
    on: Places
    """Places (p, 3) of the patch's link, of its segment's link and of its part's posture."""


class Estimates(NamedTuple):
    """Properties of each taxel (n,) that are estimated while the skin is used."""

    offset: Single
    """Rest value [counts] beyond the description's."""
    threshold: Single
    """Deviation [counts] from which a taxel is active."""
    muted: NDArray[np.bool_]
    """Taxels whose values are ignored."""
    least: Array
    """Pressure [Pa] from which it is active, infinite where it is masked."""
    fluctuating: NDArray[np.bool_]
    """Taxels with so much noise that their values never stay constant for long."""


class SkinMemory(NamedTuple):
    """Statistics of the running estimation windows, and what they are made from."""

    statistics: Single
    """(6, n), see `kernels.condition`."""
    blocks: Indices
    """(b, 4), see `kernels.condition`."""
    patches: Array
    """(p, 9), see `kernels.condition`."""
    smoothed: Array
    """Pressure (n,) [Pa] of the frame before; no taxels without smoothing."""
    room: Single
    """Raw values of one block."""
    counts: Places
    """Active taxels (p,) of each patch."""
    active: Indices
    """Their indices (n,) in the patch, from where the patch's taxels begin on."""
    pressure: Array
    """Their pressures (n,) [Pa], likewise."""


class ActiveTaxels(NamedTuple):
    """The arrays of a `SkinState`."""

    stamp: Array
    begin: Places
    active: Indices
    pressure: Array


class Clusters(NamedTuple):
    """Clusters of neighbouring taxels, patch by patch, in the order of their first taxels."""

    force: Array
    """Room (n,), zero between two frames."""
    label: Indices
    """Room (n,), zero between two frames."""
    queue: Indices
    """Room (n,)."""
    counts: Places
    """Clusters (p,) of each patch."""
    bound: Indices
    """Where the members of each cluster begin (n + 1,)."""
    member: Indices
    """Taxels (n,) of all clusters, among those of the whole skin, rising within each cluster."""
    member_force: Array
    """Force (n,) [N] on each of them."""


class ContactArrays(NamedTuple):
    """The arrays of `Contacts`, which tells their shapes and units."""

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
    reads(2), reads(2), reads(1, int32), reads(2, int32), reads(2), reads(1, int32), reads(2),
    reads(2, int64),
)  # fmt: skip
ESTIMATES = record(
    Estimates, writes(1, float32), writes(1, float32), writes(1, boolean), writes(1), writes(1, boolean)
)
MEMORY = record(
    SkinMemory, writes(2, float32), writes(2, int32), writes(2), writes(1), writes(1, float32),
    writes(1, int64), writes(1, int32), writes(1),
)  # fmt: skip
ROOM = record(ActiveTaxels, writes(1), writes(1, int64), writes(1, int32), writes(1))
ACTIVE = record(ActiveTaxels, reads(1), reads(1, int64), reads(1, int32), reads(1))
CLUSTERS = record(
    Clusters, writes(1), writes(1, int32), writes(1, int32), writes(1, int64), writes(1, int32),
    writes(1, int32), writes(1),
)  # fmt: skip
_C, _V = writes(1), writes(2)
CONTACTS = record(
    ContactArrays, writes(1, int64), writes(1, int64), _C, _C, _C, _C, _C, _V, _V, _V, _V, _V, _C, _C, _V,
    writes(1, int64), writes(1, int64), _C, _V,
)  # fmt: skip
"""Types of the above; `float64` where nothing is said."""
