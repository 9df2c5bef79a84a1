"""Arrays that the compiled loops of perception share: properties of taxels, estimates, statistics, clusters
and contacts. Data with one record per patch, taxel or contact is in structured arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float32, float64, from_dtype, int32, int64
from numpy.typing import NDArray

from tci.messages.contacts import CONTACT
from tci.messages.contacts import TAXEL as PRESSED
from tci.messages.frames import Array
from tci.robot.kernels.limb import LIMB
from tci.support.compiled import reads, record, writes

Indices = NDArray[np.int32]
Places = NDArray[np.int64]
Single = NDArray[np.float32]
Records = Any
"""Structured array (`NDArray[np.void]`). In compiled loops, the fields of a record are its attributes."""


PATCH = np.dtype(
    [
        # Index of the first taxel and of the first channel within the whole skin, and the index after the
        # last one.
        ("taxel", np.int64), ("taxel_end", np.int64), ("channel", np.int64), ("channel_end", np.int64),
        # Points of the patch's response curve: columns of `LayoutArrays.nodes`.
        ("node", np.int64), ("node_end", np.int64),
        # Sensor: lowest, highest and rest value, polarity (-1 if pressure decreases the raw values, else 1),
        # largest deviation [counts], frames per second [Hz].
        ("lowest", np.float32), ("highest", np.float32), ("rest", np.float32), ("sign", np.float32),
        ("full", np.float32), ("rate", np.float64),
        # Grid of cells around the surface, for a fast search of faces: corner [m] with the least coordinates,
        # cells per metre, cells along x, y and z (0 for a patch without faces), index of the first cell.
        ("corner", np.float64, (3,)), ("cells_per_metre", np.float64), ("cells", np.int64, (3,)),
        ("cell", np.int64),
        # Limb segment; zeros for a patch that is on none.
        ("limb", LIMB),
        # Link of the patch, link of its limb segment, and row of its part in a table of the parts' angles.
        ("link", np.int64), ("limb_link", np.int64), ("part", np.int64),
    ],
    align=True,
)  # fmt: skip
"""Constant properties of one patch."""
TAXEL = np.dtype(
    [("position", np.float64, (3,)), ("normal", np.float64, (3,)), ("area", np.float64)], align=True
)
"""Position [m], outward normal and area [m2] of one taxel, in the frame of the patch's link."""
STATE = np.dtype(
    [
        # Times [s] of the latest frame, and since the estimation window began.
        ("stamp", np.float64), ("elapsed", np.float64),
        # Number of frames so far, counted up to 2.
        ("frames", np.int64),
        # Number of frames, and of second differences of the signals, in the estimation window.
        ("in_window", np.int64), ("differences", np.int64),
        # The window ends as soon as it has this length [s] and this number of frames.
        ("due", np.float64), ("least", np.float64),
        # Number of latest frames that equal the frame before and are not yet in the statistics; -1 if the
        # next frame must be processed even if it is equal.
        ("repeats", np.int64),
        # Number of values so far that were outside the sensor's range, and of taxels saturated now.
        ("dropped", np.int64), ("saturated", np.int64),
        # Number of active taxels.
        ("active", np.int64),
    ],
    align=True,
)  # fmt: skip
"""State of one patch in conditioning."""
WAITING = np.dtype(
    [
        ("taxel", np.int64), ("since", np.float64), ("force", np.float64), ("changes", np.int64),
        ("is_last", np.bool_),
    ],
    align=True,
)  # fmt: skip
"""History of an isolated taxel, which is pressed without its neighbours: its index within the whole skin, the
time [s] since which it is active alone, the force [N] on it, how often this force has changed since then, and
True if it is the last pressed taxel of a contact whose other taxels have been released."""


def room_for(count: int, kind: np.dtype[np.void]) -> Records:
    """New records without values. `np.empty` would take 0.1 us per field of the records."""
    return np.ndarray(count, kind, np.empty(count * kind.itemsize, np.uint8))


class LayoutArrays(NamedTuple):
    """Constant properties of all n taxels and p patches of a robot. The taxels are in the order of their
    patches."""

    patches: Records
    """Records (p,) of type `PATCH`."""
    taxels: Records
    """Records (n,) of type `TAXEL`."""
    channel: Places
    """Number of each taxel's value (n,) among the raw values of all patches. For three-axis taxels this is
    the value along the normal."""
    gain: Array
    """Pressure per count (n,) [Pa] of each taxel. For a patch with a response curve: factor by which the
    pressure on this curve is multiplied."""
    nodes: Array
    """Points (2, m) of the response curves of all patches: deviations [counts] in the first row, pressures
    [Pa] in the second. Between two points a curve is linear."""
    fill: Array
    """Fill factor (n, w) around each taxel, averaged over areas of w increasing widths
    (`fill_factor.WIDTHS`)."""
    graph: Indices
    """Neighbours of each taxel, one taxel after another. The first n + 1 entries are places in this array:
    the neighbours of taxel i are from place `graph[i]` to place `graph[i + 1]` - 1.
    """
    faces: Indices
    """Triangles (f, 3) between the taxels of each patch, as indices of taxels within the whole skin."""
    cells: Indices
    """Indices of the faces in each grid cell, one cell after another. The first entries (number of cells + 1)
    are places in this array, at which the faces of each cell begin."""


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

    @classmethod
    def initial(cls, n: int) -> Estimates:
        return cls(
            offset=np.zeros(n, np.float32),
            threshold=np.zeros(n, np.float32),
            muted=np.zeros(n, np.bool_),
            least=np.zeros(n),
            fluctuating=np.zeros(n, np.bool_),
            onset=np.full(n, np.inf),
            hidden=np.zeros(n),
        )


class Statistics(NamedTuple):
    """Statistics of each taxel's signal (n,) [counts]. Those after `before` refer to the estimation
    window."""

    signal: Single
    """Latest signal."""
    before: Single
    """Signal before the latest one."""
    total: Single
    """Sum of the signals."""
    peak: Single
    """Largest absolute deviation from the rest value."""
    second_difference: Single
    """Sum of the absolute second differences of the signal."""
    changes: Single
    """Number of changes of the signal."""

    def of(self, taxels: slice) -> Statistics:
        return Statistics(*(array[taxels] for array in self))


class SkinMemory(NamedTuple):
    """Data that conditioning keeps from frame to frame."""

    statistics: Statistics
    patches: Records
    """Records (p,) of type `STATE`."""
    smoothed: Array
    """Filtered pressure (n,) [Pa] of the previous frame. The shape is (0,) if pressures are not filtered."""
    room: Single
    """Work space (n,)."""
    active: Indices
    """Active taxels of each patch, as indices within the patch. In this array (n,), the list of a patch
    begins at the index of the patch's first taxel within the whole skin."""
    pressure: Array
    """Pressures (n,) [Pa] of the active taxels, in the order of `active`."""

    @classmethod
    def initial(cls, patches: int, n: int, *, smooth: bool) -> SkinMemory:
        return cls(
            Statistics(*(np.zeros(n, np.float32) for _ in Statistics._fields)), np.zeros(patches, STATE),
            np.zeros(n if smooth else 0), np.zeros(n, np.float32), np.zeros(n, np.int32), np.zeros(n),
        )  # fmt: skip


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

    rows: Records
    """Records (c,) of type `CONTACT`."""
    begin: Places
    """Place (c + 1,) in `taxels` at which each contact's taxels begin; the last element is their number."""
    taxels: Records
    """Pressed taxels (k,): records of type `tci.messages.contacts.TAXEL`."""

    @classmethod
    def empty(cls, count: int, taxels: int) -> ContactArrays:
        """Room for `count` contacts that have `taxels` taxels altogether."""
        return cls(room_for(count, CONTACT), np.empty(count + 1, np.int64), room_for(taxels, PRESSED))


LAYOUT = record(
    LayoutArrays, reads(1, from_dtype(PATCH)), reads(1, from_dtype(TAXEL)), reads(1, int64), reads(1),
    reads(2), reads(2), reads(1, int32), reads(2, int32), reads(1, int32),
)  # fmt: skip
ESTIMATES = record(
    Estimates, writes(1, float32), writes(1, float32), writes(1, boolean), writes(1), writes(1, boolean),
    writes(1), writes(1),
)  # fmt: skip
MEMORY = record(
    SkinMemory, record(Statistics, *[writes(1, float32)] * len(Statistics._fields)),
    writes(1, from_dtype(STATE)), writes(1), writes(1, float32), writes(1, int32), writes(1),
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
