"""Classifies clusters of a single taxel as touches or sensor defects."""

from __future__ import annotations

import numpy as np
from numba import float64, from_dtype, int64

from tci.messages.frames import Array
from tci.skin.kernels.arrays import (
    ACTIVE,
    CLUSTERS,
    ESTIMATES,
    LAYOUT,
    WAITING,
    ActiveTaxels,
    Clusters,
    Estimates,
    LayoutArrays,
    Places,
    Records,
)
from tci.support.compiled import compiled, inlined, reads, returns, writes

ALIVE = 2
"""Least number of changes of the force on an isolated taxel (pressed without its neighbours) after which the
taxel counts as healthy. One change is not enough, since a new estimate of the rest value can cause it."""
SURROUNDED = 2
"""Least number of trusted neighbours of a taxel on a dense skin. A taxel with fewer neighbours nearby is on a
sparse skin, where every touch presses a single taxel."""


@inlined
def _square_distance(one: Array, other: Array) -> float:
    a, b, c = other[0] - one[0], other[1] - one[1], other[2] - one[2]
    distance2: float = a * a + b * b + c * c
    return distance2


@inlined
def _has_neighbours(taxel: int, layout: LayoutArrays, least: Array, reach: float) -> bool:
    """Returns True if a taxel has at least two trusted neighbours within `reach` [m]. `least` (n,) is
    infinite for taxels that are not trusted."""
    graph, here = layout.graph, layout.taxels[taxel].position
    found = 0
    for edge in range(graph[taxel], graph[taxel + 1]):
        other = graph[edge]
        distance2 = _square_distance(here, layout.taxels[other].position)
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
    here = layout.taxels[taxel].position
    for k in range(state.begin[p], state.begin[p + 1]):
        i = layout.patches[p].taxel + state.active[k]
        other = layout.taxels[i]
        pressed = i != taxel and state.pressure[k] * other.area >= floor
        if pressed and _square_distance(here, other.position) <= 4.0 * reach * reach:
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
def _wait_on(taxel: int, stamp: float, force: float, waiting: Records, now: Records) -> bool:
    """Writes the history of an isolated taxel, which is pressed without its neighbours, into `now`.

    `waiting` (w,) are the histories in the previous frame. Returns False if they do not contain the taxel.
    """
    now.taxel, now.since, now.force, now.changes, now.is_last = taxel, stamp, force, 0, False
    for w in range(len(waiting)):
        before = waiting[w]
        if before.taxel == taxel:
            now.since = min(before.since, stamp)
            now.changes = before.changes + (before.force != force)
            now.is_last = before.is_last
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
        reads(1, from_dtype(WAITING)),
        writes(1, from_dtype(WAITING)),
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
    waiting: Records,
    fresh: Records,
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
    `waiting` (w,) are the records that the call for the previous frame wrote to `fresh` (m,). Returns the
    number of remaining clusters, the number of their taxels, and the number of records written to `fresh`.
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
                        now.is_last = _was_touched(i, before)
                    full = end[p] * layout.gain[i] * layout.taxels[i].area
                    must_change = estimates.fluctuating[i] or force >= full
                    alive = now.changes >= ALIVE or not must_change or wait[p] <= 0.0
                    if stamp - now.since >= wait[p]:
                        keep = alive
                    else:
                        keep = now.is_last or _is_beside(i, p, state, layout, reach, floor)
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
