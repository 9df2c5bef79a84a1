"""Classifies clusters of a single taxel as touches or sensor defects."""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from tci.messages.frames import Array
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
from tci.support.compiled import compiled, inlined, reads, returns, writes

PLACE, SINCE, FORCE, CHANGED, LAST, WAITING = range(6)
"""Columns of `waiting`, a table with a row for each isolated taxel (a pressed taxel without pressed
neighbours). `WAITING` is the number of columns.

- `PLACE`: index of the taxel within the whole skin.
- `SINCE`: time [s] at which the taxel became active alone.
- `FORCE`, `CHANGED`: force [N] on the taxel, and how often this force has changed since the time `SINCE`.
- `LAST`: 1 if the taxel is the last pressed taxel of a contact whose other taxels have been released;
  otherwise 0."""
ALIVE = 2
"""Least number of changes of the force on an isolated taxel (pressed without its neighbours) after which the
taxel counts as healthy. One change is not enough, since a new estimate of the rest value can cause it."""
SURROUNDED = 2
"""Least number of trusted neighbours of a taxel on a dense skin. A taxel with fewer neighbours nearby is on a
sparse skin, where every touch presses a single taxel."""


@inlined
def _has_neighbours(taxel: int, layout: LayoutArrays, least: Array, reach: float) -> bool:
    """Returns True if a taxel has at least two trusted neighbours within `reach` [m]. `least` (n,) is
    infinite for taxels that are not trusted."""
    taxels, graph = layout.taxel, layout.graph
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    found = 0
    for edge in range(graph[taxel], graph[taxel + 1]):
        other = graph[edge]
        a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
        distance2 = a * a + b * b + c * c
        found += least[other] < np.inf and 0.0 < distance2 <= reach * reach
    return found >= SURROUNDED


@inlined
def _is_beside(
    taxel: int, p: int, state: ActiveTaxels, layout: LayoutArrays, reach: float, floor: float
) -> bool:
    """Returns True if another active taxel of the patch, with a force of at least `floor` [N], is within
    twice `reach` [m] of `taxel`.

    One touch across a gap in the skin may press both taxels.
    """
    taxels = layout.taxel
    x, y, z = taxels[taxel, 0], taxels[taxel, 1], taxels[taxel, 2]
    for k in range(state.begin[p], state.begin[p + 1]):
        other = layout.begin[p, TAXEL] + state.active[k]
        if other != taxel and state.pressure[k] * taxels[other, AREA] >= floor:
            a, b, c = taxels[other, 0] - x, taxels[other, 1] - y, taxels[other, 2] - z
            if a * a + b * b + c * c <= 4.0 * reach * reach:
                return True
    return False


@inlined
def _was_touched(taxel: int, before: Places) -> bool:
    """Returns True if `taxel` is one of the taxels `before` (k,), which were part of a contact in the
    previous frame.

    All taxels are given as indices within the whole skin.
    """
    touched = False
    for k in range(len(before)):
        touched |= before[k] == taxel
    return touched


@inlined
def _wait_on(place: int, stamp: float, force: float, waiting: Array, now: Array) -> bool:
    """Writes the history of an isolated taxel, which is pressed without its neighbours, into `now` (5,).

    `waiting` (w, 5) are the histories in the previous frame. Returns False if they do not contain the taxel.
    """
    now[PLACE], now[SINCE], now[FORCE], now[CHANGED], now[LAST] = place, stamp, force, 0.0, 0.0
    for w in range(len(waiting)):
        if int(waiting[w, PLACE]) == place:
            now[SINCE] = min(waiting[w, SINCE], stamp)
            now[CHANGED] = waiting[w, CHANGED] + (waiting[w, FORCE] != force)
            now[LAST] = waiting[w, LAST]
            return True
    return False


@compiled(
    returns(int64, int64, int64)(
        ACTIVE,
        LAYOUT,
        ESTIMATES,
        CLUSTERS,
        float64,
        float64,
        reads(2),
        reads(1, int64),
        reads(2),
        writes(2),
    )
)
def reject_isolated(
    state: ActiveTaxels,
    layout: LayoutArrays,
    estimates: Estimates,
    clusters: Clusters,
    reach: float,
    floor: float,
    rules: Array,
    before: Places,
    waiting: Array,
    fresh: Array,
) -> tuple[int, int, int]:
    """Removes clusters of a single taxel that do not count as a touch, under the conditions of
    `IsolatedSettings`.

    The first row of `rules` (2, p) is the time [s] for which an isolated taxel (pressed without its
    neighbours) of each patch must be pressed; with 0, all isolated taxels of the patch are kept. The second
    row is the pressure at the end of the sensor's range, without the taxels' gains. A taxel with at least
    this pressure, or with so much noise that its value should not stay constant, must also have changed its
    value at least twice (`ALIVE`) while it was pressed. `reach` [m] is the largest distance between two
    pressed taxels that may belong to one touch. `floor` [N] is the least force on a taxel of a contact.
    `before` (k,) are the taxels of all contacts in the previous frame, as indices within the whole skin.
    `waiting` (w, 5) are the rows that the call for the previous frame wrote to `fresh` (m, 5). Returns the
    number of remaining clusters, the number of their taxels, and the number of rows written to `fresh`.
    """
    waits, kept, filled, c, begin = 0, 0, 0, 0, 0
    bound, member, forces = clusters.bound, clusters.member, clusters.member_force
    wait, end = rules
    for p in range(len(clusters.counts)):
        last, kept_before = c + clusters.counts[p], kept
        while c < last:
            until, keep = bound[c + 1], True
            if until - begin == 1:
                i, force = member[begin], forces[begin]
                keep = not _has_neighbours(i, layout, estimates.least, reach)
                if not keep:
                    now, stamp = fresh[waits], state.stamp[p]
                    waits += 1
                    if not _wait_on(i, stamp, force, waiting, now):
                        now[LAST] = _was_touched(i, before)
                    full = end[p] * layout.gain[i] * layout.taxel[i, AREA]
                    must_change = estimates.fluctuating[i] or force >= full
                    alive = now[CHANGED] >= ALIVE or not must_change or wait[p] <= 0.0
                    if stamp - now[SINCE] >= wait[p]:
                        keep = alive
                    else:
                        keep = now[LAST] > 0.0 or _is_beside(i, p, state, layout, reach, floor)
            if keep:
                for k in range(begin, until):
                    member[filled], forces[filled] = member[k], forces[k]
                    filled += 1
                kept += 1
                bound[kept] = filled
            begin = until
            c += 1
        clusters.counts[p] = kept - kept_before
    return kept, filled, waits
