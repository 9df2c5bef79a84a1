"""Classifies clusters of a single taxel as light touches or sensor defects."""

from __future__ import annotations

import numpy as np
from numba import int64

from tci.compiled import compiled, inlined, reads, returns, writes
from tci.frames import Array
from tci.skin.kernels.arrays import (
    ACTIVE,
    AREA,
    CLUSTERS,
    ESTIMATES,
    LAYOUT,
    TAXEL,
    ActiveTaxels,
    Clusters,
    Estimates,
    LayoutArrays,
    Places,
)

COVER, TIP, REACH, SURE, FLOOR = range(5)
"""Indices in `limits`, see `IsolatedSettings`; FLOOR is the least force [N] on a taxel of a contact."""
PLACE, SINCE, FORCE, CHANGED, LEFT, WAITING = range(6)
"""Columns of `waiting`, and their number: a taxel of the whole skin, the time [s] at which it became active
alone, its force [N], how often that has changed since, and 1 if it is what is left of a contact."""
ALIVE = 2
"""Number of changes of an isolated taxel's force that show it is healthy: one change may come from a new
estimate of its rest value."""
ONE_SIDED = 0.5
"""Length of the mean unit vector towards a taxel's neighbours above which they do not surround it: 0.43 at
the straight edge of a triangular lattice, 0.67 and more at corners."""


@inlined
def _must_respond(taxel: int, force: float, layout: LayoutArrays, least: Array, limits: Array) -> int:
    """Returns 1 if neighbours would respond to a touch of one taxel, 0 if they need not, -1 if they can't
    tell.

    They need not respond to a light touch or to one beside all of them; fewer than two near and trusted
    neighbours can't tell.
    """
    taxels, graph = layout.taxel, layout.graph
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    nx, ny, nz = taxels[taxel, 3], taxels[taxel, 4], taxels[taxel, 5]
    area = taxels[taxel, AREA]
    tip = limits[TIP] * force ** (1.0 / 3.0)
    variance = limits[COVER] ** 2 + area / 12.0 + tip**2 / 4.0
    found, across, along, up = 0, 0.0, 0.0, 0.0
    response = 0
    for edge in range(graph[taxel], graph[taxel + 1]):
        other = graph[edge]
        a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
        distance2 = a * a + b * b + c * c
        if not least[other] < np.inf or distance2 > limits[REACH] ** 2 or distance2 == 0.0:
            continue
        out = a * nx + b * ny + c * nz
        a, b, c = a - out * nx, b - out * ny, c - out * nz
        length = np.sqrt(a * a + b * b + c * c)
        if length > 0.0:
            across, along, up = across + a / length, along + b / length, up + c / length
        found += 1
        pressure = force / area * np.exp(-distance2 / (2.0 * variance))
        response |= pressure >= limits[SURE] * max(least[other], limits[FLOOR] / taxels[other, AREA])
    if found < 2:
        return -1
    return 0 if across**2 + along**2 + up**2 > (ONE_SIDED * found) ** 2 else int(response)


@inlined
def _is_beside(taxel: int, p: int, state: ActiveTaxels, layout: LayoutArrays, limits: Array) -> bool:
    """Returns True if another active taxel of the patch is within twice the reach: one touch over a gap in
    the skin."""
    taxels, reach = layout.taxel, 2.0 * limits[REACH]
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    for k in range(state.begin[p], state.begin[p + 1]):
        other = layout.begin[p, TAXEL] + state.active[k]
        if other != taxel and state.pressure[k] * taxels[other, AREA] >= limits[FLOOR]:
            a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
            if a * a + b * b + c * c <= reach * reach:
                return True
    return False


@inlined
def _was_touched(taxel: int, before: Places) -> bool:
    """Returns True if a taxel of the whole skin was part of a contact in the frame before."""
    touched = False
    for k in range(len(before)):
        touched |= before[k] == taxel
    return touched


@inlined
def _wait_on(place: int, stamp: float, force: float, waiting: Array, now: Array) -> bool:
    """Writes the waiting state `now` (WAITING,) of an isolated taxel; returns False if it has just begun."""
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
        ACTIVE, LAYOUT, ESTIMATES, CLUSTERS, reads(1), reads(1), reads(1, int64), reads(2), writes(2)
    )
)
def reject_isolated(
    state: ActiveTaxels,
    layout: LayoutArrays,
    estimates: Estimates,
    clusters: Clusters,
    limits: Array,
    wait: Array,
    before: Places,
    waiting: Array,
    fresh: Array,
) -> tuple[int, int, int]:
    """Removes clusters of a single taxel that are no touch, see `IsolatedSettings`.

    An isolated taxel must be pressed for `wait` (p,) [s], 0 for none; `before` (k,) are the taxels, among
    those of the whole skin, of all contacts in the frame before, and `waiting` (w, WAITING) the isolated
    taxels then. Returns the number of clusters left, the number of their taxels, and the number of rows of
    `fresh` (m, WAITING) that were written: the next `waiting`.
    """
    waits, kept, filled, c, begin = 0, 0, 0, 0, 0
    bound, member, forces = clusters.bound, clusters.member, clusters.member_force
    for p in range(len(clusters.counts)):
        last, kept_before = c + clusters.counts[p], kept
        while c < last:
            end, keep = bound[c + 1], True
            if end - begin == 1:
                i, force = member[begin], forces[begin]
                response = _must_respond(i, force, layout, estimates.least, limits)
                keep = response < 0
                if response == 0:
                    now, stamp = fresh[waits], state.stamp[p]
                    waits += 1
                    if not _wait_on(i, stamp, force, waiting, now):
                        now[LEFT] = _was_touched(i, before)
                    alive = now[CHANGED] >= ALIVE or not estimates.fluctuating[i] or wait[p] <= 0.0
                    keep = alive if stamp - now[SINCE] >= wait[p] else now[LEFT] > 0.0
                    keep = keep or _is_beside(i, p, state, layout, limits)
            if keep:
                for k in range(begin, end):
                    member[filled], forces[filled] = member[k], forces[k]
                    filled += 1
                kept += 1
                bound[kept] = filled
            begin = end
            c += 1
        clusters.counts[p] = kept - kept_before
    return kept, filled, waits
