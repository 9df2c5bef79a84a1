"""Arrays that the compiled loops of perception share: properties of taxels, estimates, statistics, clusters
and contacts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float32, float64, from_dtype, int32, int64
from numpy.typing import NDArray

from tci.messages.contacts import CONTACT
from tci.messages.contacts import TAXEL as PRESSED
from tci.messages.frames import Array
from tci.support.compiled import reads, record, writes

Indices = NDArray[np.int32]
Places = NDArray[np.int64]
Single = NDArray[np.float32]

TAXEL, CHANNEL, BLOCK, CELL, NODE = range(5)
"""Columns of `LayoutArrays.begin`, which contains the index of each patch's first element in arrays of the
whole skin. The elements are taxels, channels, blocks of up to 64 taxels, cells of the grid for the search of
faces, and points of response curves."""
LOWEST, HIGHEST, REST, SIGN, FULL = range(5)
"""Columns of `LayoutArrays.sensor`, with a row for each patch's sensor: lowest raw value, highest raw value,
rest value, polarity (-1 if pressure decreases the raw values, else 1), and largest deviation [counts]."""
FIRST, END, STRAIGHT = range(3)
"""Columns of `LayoutArrays.span`, with a row for each block of up to 64 taxels of a patch: smallest channel,
largest channel + 1, and 1 if the channels of successive taxels are consecutive, otherwise 0."""
AREA = 6
"""Column of `LayoutArrays.taxel` with the area [m2] of each taxel. The columns before contain position and
normal."""
LINK, LIMB_LINK, POSTURE = range(3)
"""Columns of `LayoutArrays.on`, with a row of indices for each patch: link of the patch, link of the patch's
limb segment, and row of the patch's part in a table of the parts' angles."""
BLOCK_SIZE = 64
"""Largest number of taxels in a block, which is a group of successive taxels that are processed together. A
block whose raw values equal those of the previous frame is not computed again."""


class LayoutArrays(NamedTuple):
    """Constant properties of all n taxels and p patches of a robot. The taxels are in the order of their
    patches."""

    begin: Places
    """Indices (p + 1, 5) of each patch's first element in arrays of the whole skin. The columns are for
    taxels, channels, blocks of up to 64 taxels, grid cells, and points of response curves. The last row
    contains the totals."""
    sensor: Single
    """Properties (p, 5) of each patch's sensor: lowest raw value, highest raw value, rest value, polarity (-1
    if pressure decreases the raw values, else 1), and largest deviation [counts]."""
    rate: Array
    """Number of frames per second (p,) [Hz] that each patch sends."""
    channel: Places
    """Index (n,) of each taxel's value among the raw values of all patches. For three-axis taxels this is the
    value along the normal."""
    span: Places
    """Channels (b, 3) of each block of up to 64 taxels of a patch: smallest channel, largest channel + 1, and
    1 if the channels of successive taxels are consecutive, otherwise 0."""
    gain: Array
    """Pressure per count (n,) [Pa] of each taxel. For a patch with a response curve: factor by which the
    pressure on this curve is multiplied."""
    nodes: Array
    """Points (2, m) of the response curves of all patches: deviations [counts] in the first row, pressures
    [Pa] in the second. Between two points a curve is linear."""
    taxel: Array
    """Rows (n, 7) with position (3,) [m], outward normal (3,) and area [m2] of each taxel, in the frame of
    the patch's link."""
    fill: Array
    """Fill factor (n, w) around each taxel, averaged over areas of w increasing widths
    (`fill_factor.WIDTHS`)."""
    graph: Indices
    """Neighbours of each taxel, one taxel after another. The first n + 1 entries are places in this array:
    the neighbours of taxel i are from place `graph[i]` to place `graph[i + 1]` - 1.
    """
    faces: Indices
    """Triangles (f, 3) between the taxels of each patch, as indices of taxels within the whole skin."""
    box: Array
    """Grid of cells (p, 7) around each patch's surface, for a fast search of faces: the corner (3,) [m] with
    the lowest coordinates, the number of cells per metre, and the number of cells along x, y and z. Zeros for
    a patch without faces."""
    cells: Indices
    """Indices of the faces in each grid cell, one cell after another. The first entries (number of cells + 1)
    are places in this array, at which the faces of each cell begin."""
    limb: Array
    """Properties (p, 15) of each patch's limb segment: rotation matrix of the mount in the torso frame (9
    numbers), origin (3 numbers) [m] in the segment's link, length [m], side (+1 left, -1 right), and index of
    the segment. Zeros for a patch that is on no limb segment.
    """
    on: Places
    """Indices (p, 3) for each patch: its link, the link of its limb segment, and the row of its part in a
    table of the parts' angles."""


class Estimates(NamedTuple):
    """Properties of each taxel (n,) that are estimated at run time."""

    offset: Single
    """Rest value [counts] minus the rest value in the description. The sign is reversed if pressure decreases
    the raw values."""
    threshold: Single
    """Deviation [counts] above which a taxel is active."""
    muted: NDArray[np.bool_]
    """True for taxels whose values are ignored."""
    least: Array
    """Pressure [Pa] above which a taxel is active. The value is infinite if the taxel is masked."""
    fluctuating: NDArray[np.bool_]
    """True for taxels with so much noise that their values never stay constant for long."""
    onset: Array
    """Least pressure [Pa] of a light touch: the pressure at a deviation of two counts. The value is infinite
    while the taxel's noise is unknown."""
    hidden: Array
    """Pressure [Pa] below which the edge of a touch is not measured. The value is 0 for taxels on which a
    touch has no gradual edge, such as switches and the taxels of a palm or a sole."""


class SkinMemory(NamedTuple):
    """Data that conditioning keeps from frame to frame: statistics of the signals, filtered pressures and
    active taxels."""

    statistics: Single
    """Statistics (6, n) with a column for each taxel. The first two rows are the latest signal [counts] and
    the signal before. The other rows refer to the estimation window: sum of the signals, largest absolute
    deviation from the rest value, sum of the absolute second differences of the signal, and number of changes
    of the signal."""
    blocks: Indices
    """Table (b, 4) with a row for each block of up to 64 taxels: number of repeated frames that are not yet
    in the statistics, 1 if another equal frame would only be counted, 1 if any taxel is active, and number of
    saturated taxels."""
    patches: Array
    """State (p, 9) of each patch, for example the time of its latest frame and the length of its estimation
    window. The constants from `STAMP` to `LEAST` in `kernels.condition` are the columns."""
    smoothed: Array
    """Filtered pressure (n,) [Pa] of the previous frame. The shape is (0,) if pressures are not filtered."""
    room: Single
    """Work space (64,) for one number per taxel of a block."""
    counts: Places
    """Number of active taxels (p,) of each patch."""
    active: Indices
    """Active taxels of each patch, as indices within the patch. In this array (n,), the list of a patch
    begins at the index of the patch's first taxel within the whole skin, and has the length `counts`."""
    pressure: Array
    """Pressures (n,) [Pa] of the active taxels, in the order of `active`."""


class ActiveTaxels(NamedTuple):
    """Active taxels of the whole skin and their pressures, in the form that the compiled loops need. The
    fields are those of `SkinState`."""

    stamp: Array
    begin: Places
    active: Indices
    pressure: Array


class Limits(NamedTuple):
    """Least forces [N] for a contact: on each of its taxels (`floor`), and on at least one taxel (`touch`, or
    `light` if the taxel is clearly above its noise)."""

    floor: float
    light: float
    touch: float


class Clusters(NamedTuple):
    """Clusters of neighbouring active taxels, patch by patch.

    On each patch, clusters are ordered by the lowest index of their taxels.
    """

    force: Array
    """Scratch memory (n,) for the force on each taxel [N]. All its values are zero between two frames."""
    label: Indices
    """Scratch memory (n,) for the number of each taxel's cluster. All values are zero between two frames."""
    queue: Indices
    """Scratch memory (n,) for lists of taxels during the search for clusters."""
    counts: Places
    """Number of clusters (p,) on each patch."""
    bound: Indices
    """Place (n + 1,) in `member` at which each cluster begins. The entry after the last cluster is the number
    of taxels in all clusters."""
    member: Indices
    """Taxels (n,) of all clusters, cluster by cluster, as indices within the whole skin. Within each cluster
    the indices increase."""
    member_force: Array
    """Force (n,) [N] on each taxel in `member`."""


class ContactArrays(NamedTuple):
    """Contacts of one frame, in the form that the compiled loops write."""

    rows: Any
    """Records (c,) of type `CONTACT`."""
    begin: Places
    """Place (c + 1,) in `taxels` at which each contact's taxels begin; the last element is their number."""
    taxels: Any
    """Records (k,) of type `TAXEL`."""

    @classmethod
    def empty(cls, count: int, taxels: int) -> ContactArrays:
        """Room for `count` contacts that have `taxels` taxels altogether."""
        return cls(np.empty(count, CONTACT), np.empty(count + 1, np.int64), np.empty(taxels, PRESSED))


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
CONTACTS = record(
    ContactArrays, writes(1, from_dtype(CONTACT)), writes(1, int64), writes(1, from_dtype(PRESSED))
)
