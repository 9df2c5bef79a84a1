"""One frame of a skin: which taxels that are pressed all alone are touches."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int32, int64
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, returns, views, writes
from tci.frames import Array
from tci.skin.kernels.flat import Indices
from tci.skin.kernels.whole import GRAPH, TAXEL

COVER, TIP, REACH, SURE = range(4)
"""Places in `limits`, see `LoneSettings`."""
PLACE, SINCE, FORCE, CHANGED, LEFT, WAITING = range(6)
"""Columns of `waiting`, and their number: a taxel among all of the skin, when it began to be pressed alone
[s], its force [N], how often that has changed since, and 1 where it is what is left of a contact."""
ALIVE = 2
"""Changes of a lone taxel's force that show it is alive: one may come from its rest value, learnt anew."""
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
    """1 where a touch on one taxel alone would be felt by neighbours too, 0 where it need not be, being too
    light or beside all of them, -1 where neighbours say nothing: fewer than two are near and believed."""
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
    if found < 2:
        return -1
    return 0 if across**2 + along**2 + up**2 > (ONE_SIDED * found) ** 2 else int(felt)


@inlined
def _is_beside(taxel: int, forces: Array, taxels: Array, floor: float, reach: float) -> bool:
    """Whether another taxel within `reach` [m] is pressed: the same touch, over a gap in the skin."""
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    for other in range(len(forces)):
        if forces[other] >= floor and other != taxel:
            a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
            if a * a + b * b + c * c <= reach * reach:
                return True
    return False


@inlined
def _is_left(taxel: int, p: int, bounds: Indices, patches: Indices, indices: Indices) -> bool:
    """Whether a taxel of a patch was part of a contact before."""
    for c in range(len(patches)):
        if patches[c] == p:
            for k in range(bounds[c], bounds[c + 1]):
                if indices[k] == taxel:
                    return True
    return False


@inlined
def _wait_on(place: int, stamp: float, force: float, waiting: Array, now: Array) -> bool:
    """Write how long a lone taxel waits `now` (WAITING,); false if it has just begun to."""
    now[PLACE], now[SINCE], now[FORCE], now[CHANGED], now[LEFT] = place, stamp, force, 0.0, 0.0
    for w in range(len(waiting)):
        if int(waiting[w, PLACE]) == place:
            now[SINCE] = min(waiting[w, SINCE], stamp)
            now[CHANGED] = waiting[w, CHANGED] + (waiting[w, FORCE] != force)
            now[LEFT] = waiting[w, LEFT]
            return True
    return False


@compiled(
    returns(int64, int64, int64)(
        reads(1), reads(1), reads(1, boolean), reads(2), reads(1, int32), reads(2, int64), float64, reads(1),
        reads(1), views(1), reads(1, int64), reads(1, int64), reads(1, int64), reads(2), writes(1, int32),
        writes(1, int64), writes(2),
    )
)  # fmt: skip
def leave_out(
    force: Array,
    least: Array,
    lively: NDArray[np.bool_],
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
    believed; `lively` (n,) ones never stay the same. A lone taxel must be pressed for `wait` (p,) [s], 0 for
    none; `stamps` (p,) [s] are those of the patches' frames; `bounds`, `patches` and `indices` are the
    contacts of the frame before, see `ContactTable`, and `waiting` (w, WAITING) the lone taxels then. Gives
    the number of contacts and of their taxels, and how many rows of `fresh` (m, WAITING) are in use: what is
    `waiting` next.
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
                    now = fresh[waits]
                    waits += 1
                    if not _wait_on(a + i, stamps[p], force[a + i], waiting, now):
                        now[LEFT] = _is_left(i, p, bounds, patches, indices)
                    lasts = stamps[p] - now[SINCE] >= wait[p]
                    alive = now[CHANGED] >= ALIVE or not lively[a + i] or wait[p] == 0.0
                    keep = alive if lasts else now[LEFT] > 0.0
                    keep = keep or _is_beside(i, force[a:b], taxels[a:b], floor, 2.0 * limits[REACH])
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
