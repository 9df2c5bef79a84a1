"""One frame of a skin: which taxels that are pressed all alone are touches."""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64

from tci.frames import Array
from tci.interface.kernels.arrays import reads, returns, writes
from tci.interface.kernels.compiled import compiled, inlined
from tci.interface.kernels.flat import Indices
from tci.interface.kernels.whole import GRAPH, TAXEL

COVER, TIP, REACH, SURE = range(4)
"""Places in `limits`, see `LoneSettings`."""
PLACE, SINCE = range(2)
"""Columns of `waiting`: a taxel among all of the skin, and when it began to be pressed alone [s]."""
ONE_SIDED = 0.5
"""Length of the mean of the unit vectors towards a taxel's neighbours from which they do not surround it:
0.43 at the straight edge of a triangular lattice, 0.67 and more at corners."""


@inlined
def _must_be_felt(
    taxel: int,
    forces: Array,
    least: Array,
    taxels: Array,
    graph: Indices,
    floor: float,
    limits: Array,
) -> int:
    """1 where a touch on one taxel alone would be felt by neighbours too, 0 where it need not be,
    -1 where neighbours say nothing: too far away, not believed, or on one side only."""
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    nx, ny, nz = taxels[taxel, 3], taxels[taxel, 4], taxels[taxel, 5]
    force, area = forces[taxel], taxels[taxel, 6]
    tip = limits[TIP] * force ** (1.0 / 3.0)
    variance = limits[COVER] ** 2 + area / 12.0 + tip**2 / 4.0
    found, across, along, up = 0, 0.0, 0.0, 0.0
    felt = 0
    for edge in range(graph[taxel], graph[taxel + 1]):
        other = graph[edge]
        a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
        apart = a * a + b * b + c * c
        believed = least[other] < np.inf and forces[other] >= 0.0  # NaN is not
        if not believed or apart > limits[REACH] ** 2 or apart == 0.0:
            continue
        out = a * nx + b * ny + c * nz
        a, b, c = a - out * nx, b - out * ny, c - out * nz
        length = np.sqrt(a * a + b * b + c * c)
        if length > 0.0:
            across, along, up = across + a / length, along + b / length, up + c / length
        found += 1
        pressure = force / area * np.exp(-apart / (2.0 * variance))
        felt |= pressure >= limits[SURE] * max(least[other], floor / taxels[other, 6])
    if found == 0 or across**2 + along**2 + up**2 > (ONE_SIDED * found) ** 2:
        return -1
    return int(felt)


@inlined
def _goes_on(taxel: int, p: int, bounds: Indices, patches: Indices, indices: Indices) -> bool:
    """Whether a taxel of a patch was part of a contact before."""
    for c in range(len(patches)):
        if patches[c] == p:
            for k in range(bounds[c], bounds[c + 1]):
                if indices[k] == taxel:
                    return True
    return False


@inlined
def _since(place: int, stamp: float, waiting: Array) -> float:
    for w in range(len(waiting)):
        if int(waiting[w, PLACE]) == place:
            return min(waiting[w, SINCE], stamp)  # type: ignore[no-any-return]
    return stamp


@compiled(
    returns(int64, int64, int64)(
        reads(1), reads(1), reads(2), reads(1, int32), reads(2, int64), float64, reads(1), reads(1), reads(1),
        reads(1, int64), reads(1, int64), reads(1, int64), reads(2), writes(1, int32), writes(1, int64),
        writes(2),
    )
)  # fmt: skip
def leave_out(
    force: Array,
    least: Array,
    taxels: Array,
    graph: Indices,
    begins: Indices,
    floor: float,
    limits: Array,
    wait: Array,
    stamps: Array,
    bounds: Indices,
    patches: Indices,
    indices: Indices,
    waiting: Array,
    work: Indices,
    counts: Indices,
    fresh: Array,
) -> tuple[int, int, int]:
    """Leave out what `cluster_all` found in `work` and `counts` and what is no touch, see `LoneSettings`.

    `least` (n,) [Pa] is the pressure from which each taxel feels something, infinite where it is not
    believed; `wait` (p,) [s] how long a lone taxel must be pressed, `stamps` (p,) [s] of the patches' frames;
    `bounds`, `patches` and `indices` are the contacts of the frame before, see `ContactTable`, and `waiting`
    (w, 2) the lone taxels that were no touch yet. Gives the number of contacts and of their taxels, and how
    many there are in `fresh` (m, 2), what is `waiting` next.
    """
    contacts, members_n, waits = 0, 0, 0
    for p in range(len(counts)):
        if counts[p] == 0:
            continue
        a, b = begins[p, TAXEL], begins[p + 1, TAXEL]
        own = work[4 * a + p : 4 * b + p + 1]
        ends = own[b - a :]
        edges = graph[begins[p, GRAPH] : begins[p + 1, GRAPH]]
        kept, filled, begin = 0, 0, 0
        for c in range(counts[p]):
            end = ends[c + 1]
            keep = True
            if end - begin == 1:
                i = own[begin]
                told = _must_be_felt(i, force[a:b], least[a:b], taxels[a:b], edges, floor, limits)
                keep = told < 0
                if told == 0:
                    since = _since(a + i, stamps[p], waiting)
                    keep = _goes_on(i, p, bounds, patches, indices) or stamps[p] - since >= wait[p]
                    if not keep:
                        fresh[waits, PLACE], fresh[waits, SINCE] = a + i, since
                        waits += 1
            if keep:
                for k in range(begin, end):
                    own[filled] = own[k]
                    filled += 1
                kept += 1
                ends[kept] = filled
            begin = end
        counts[p] = kept
        contacts += kept
        members_n += filled
    return contacts, members_n, waits
