"""One frame of one patch: which taxels belong together, and where and how hard each contact presses."""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64, void

from tci.frames import Array
from tci.interface.kernels.arrays import reads, views, writes
from tci.interface.kernels.compiled import compiled, inlined
from tci.interface.kernels.flat import Indices
from tci.interface.kernels.limb import limb_pose
from tci.interface.kernels.nearest import nearest

FORCE, PEAK, AREA, U, THETA = range(5)
"""Columns of `numbers`: force [N], that of the strongest taxel, area [m2], place on the limb."""
NUMBERS = 5
P_L, N_L, P_T, N_T, F_T = range(5)
"""Rows of `vectors`: centre and normal in the link, both seen from the torso, force [N] there."""
VECTORS = 5
_BLOCK = 64


@inlined
def _deal(active: Indices, label: Indices, bounds: Indices, members: Indices, count: int) -> None:
    for taxel in active:
        mine = label[taxel]
        label[taxel] = 0
        if mine > 0:
            members[bounds[mine - 1]] = taxel
            bounds[mine - 1] += 1
    # Each bound has moved to the next one's place.
    for i in range(count, 0, -1):
        bounds[i] = bounds[i - 1]
    bounds[0] = 0


@inlined
def _scan(force: Array, floor: float, members: Indices) -> int:
    """Write the `members` that feel at least the floor; how many."""
    n, active = len(force), 0
    for block in range(0, n, _BLOCK):
        end = min(block + _BLOCK, n)
        # A slice, since its indices are known to count up from 0: the processor compares four at once.
        part = force[block:end]
        some = 0
        for i in range(len(part)):
            some += part[i] >= floor
        if some:
            for i in range(len(part)):
                if part[i] >= floor:
                    members[active] = block + i
                    active += 1
    return active


@inlined
def _group(force: Array, floor: float, touch: float, graph: Indices, work: Indices, active: int) -> int:
    n = len(force)
    members, bounds = work[:n], work[n : 2 * n + 1]
    label, queue = work[2 * n + 1 : 3 * n + 1], work[3 * n + 1 :]
    if active == 0:
        return 0
    count = 0
    bounds[0] = 0
    for place in range(active):
        seed = members[place]
        if label[seed] != 0:
            continue
        label[seed] = count + 1
        queue[0] = seed
        done, size = 0, 1
        peak = force[seed]
        while done < size:
            taxel = queue[done]
            done += 1
            peak = max(peak, force[taxel])
            for edge in range(graph[taxel], graph[taxel + 1]):
                other = graph[edge]
                if label[other] == 0 and force[other] >= floor:
                    label[other] = count + 1
                    queue[size] = other
                    size += 1
        if peak >= touch:
            count += 1
            bounds[count] = bounds[count - 1] + size
        else:
            for i in range(size):
                label[queue[i]] = -1
    # All active taxels in their order, dealt to their clusters.
    for place in range(active):
        queue[place] = members[place]
    _deal(queue[:active], label, bounds, members, count)
    return count


@compiled(int64(reads(1), float64, float64, reads(1, int32), writes(1, int32)))
def cluster(force: Array, floor: float, touch: float, graph: Indices, work: Indices) -> int:
    """Single-link clusters of taxels with `force` (n,) >= floor, those with one >= touch; their number.

    `work` (4 n + 1,) is memory that is zero before the first call. It holds then all members (n,), each
    cluster's in their order, the cluster of the first taxel first, and their bounds (n + 1,).
    """
    return _group(force, floor, touch, graph, work, _scan(force, floor, work[: len(force)]))  # type: ignore[no-any-return]


@compiled(int64(reads(1), float64, float64, reads(1, int32), reads(1, int32), writes(1, int32)))
def cluster_of(
    force: Array, floor: float, touch: float, active: Indices, graph: Indices, work: Indices
) -> int:
    """`cluster` where no other taxels than the `active` (k,) ones, in their order, feel anything."""
    found = 0
    for place in range(len(active)):
        if force[active[place]] >= floor:
            work[found] = active[place]
            found += 1
    return _group(force, floor, touch, graph, work, found)  # type: ignore[no-any-return]


@inlined
def _on_limb(T_SL: Array, x: float, y: float, z: float, length: float, side: float) -> tuple[float, float]:
    """u and theta [rad] of a point of the link (eq. 4), see `limb_coordinates`; NaN without a limb."""
    if length == 0.0:
        return np.nan, np.nan
    x_S = T_SL[0, 0] * x + T_SL[0, 1] * y + T_SL[0, 2] * z + T_SL[0, 3]
    y_S = T_SL[1, 0] * x + T_SL[1, 1] * y + T_SL[1, 2] * z + T_SL[1, 3]
    z_S = T_SL[2, 0] * x + T_SL[2, 1] * y + T_SL[2, 2] * z + T_SL[2, 3]
    return -z_S / length, np.arctan2(side * y_S, x_S)


@compiled(
    void(
        reads(1), reads(1, int32), reads(2), reads(2, int32), reads(1), reads(1, int32), views(2), views(2),
        reads(1), views(1), writes(2), writes(3), writes(1, int64), writes(2),
    ),
)  # fmt: skip
def describe(
    force: Array,
    work: Indices,
    taxels: Array,
    faces: Indices,
    box: Array,
    cells: Indices,
    T_TL: Array,
    T_TG: Array,
    limb: Array,
    posture: Array,
    numbers: Array,
    vectors: Array,
    indices: Indices,
    places: Array,
) -> None:
    """Fill in the contacts that `cluster` found: `numbers` (c, NUMBERS), `vectors` (c, VECTORS, 3), and of
    all their taxels (k,) the `indices` and `places`: force [N], u and theta (3, k).

    `T_TL` (4, 4) is the pose of the patch's link, `T_TG` of its segment's; `limb` and `posture` as in
    `limb_pose`.
    """
    n = len(force)
    members, bounds = work[:n], work[n : 2 * n + 1]
    T_SL = np.empty((4, 4))
    length, side = limb[12], limb[13]
    if length > 0.0:
        limb_pose(T_TL, T_TG, limb, posture, T_SL)
    mean = np.empty(3)
    for c in range(len(numbers)):
        total, peak, area = 0.0, 0.0, 0.0
        mean[:] = 0.0
        for place in range(bounds[c], bounds[c + 1]):
            i = members[place]
            f = force[i]
            total += f
            peak = max(peak, f)
            area += taxels[i, 6]
            for axis in range(3):
                mean[axis] += f * taxels[i, axis]
            indices[place] = i
            places[0, place] = f
            u, theta = _on_limb(T_SL, taxels[i, 0], taxels[i, 1], taxels[i, 2], length, side)
            places[1, place] = u
            places[2, place] = theta
        mean /= total
        p_L, n_L = vectors[c, P_L], vectors[c, N_L]
        nearest(mean, taxels, faces, box, cells, p_L, n_L)
        for row in range(3):
            n_T = T_TL[row, 0] * n_L[0] + T_TL[row, 1] * n_L[1] + T_TL[row, 2] * n_L[2]
            at = T_TL[row, 0] * p_L[0] + T_TL[row, 1] * p_L[1] + T_TL[row, 2] * p_L[2]
            vectors[c, P_T, row] = at + T_TL[row, 3]
            vectors[c, N_T, row] = n_T
            vectors[c, F_T, row] = -total * n_T
        u, theta = _on_limb(T_SL, p_L[0], p_L[1], p_L[2], length, side)
        numbers[c, FORCE] = total
        numbers[c, PEAK] = peak
        numbers[c, AREA] = area
        numbers[c, U] = u
        numbers[c, THETA] = theta
