"""One frame of one patch: which taxels belong together, and where and how hard each contact presses."""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64

from tci.compiled import compiled, inlined, reads, writes
from tci.frames import Array
from tci.robot.kernels.limb import Row, limb_pose
from tci.robot.limb import RHO
from tci.skin.kernels.flat import Indices
from tci.skin.kernels.nearest import nearest

FORCE, PEAK, AREA, U, THETA, Y, Z = range(7)
"""Columns of `numbers`: force [N], that of the strongest taxel, area [m2], place on the limb, and
on the generic limb."""
NUMBERS = 7
P_L, N_L, P_T, N_T, F_T = range(5)
"""Rows of `vectors`: centre and normal in the link, both seen from the torso, force [N] there."""
VECTORS = 5
_BLOCK = 64
_NONE, _ONE = np.uint64(0), np.uint64(1)
"""Places that are counted without a sign need no look at whether they count from the end."""


@inlined
def _deal(active: Indices, label: Indices, bounds: Indices, members: Indices, count: int) -> None:
    for place in range(np.uint64(len(active))):
        taxel = np.uint64(active[place])
        mine = label[taxel]
        label[taxel] = 0
        if mine > 0:
            cluster = np.uint64(mine - 1)
            members[np.uint64(bounds[cluster])] = active[place]
            bounds[cluster] += 1
    # Each bound has moved to the next one's place.
    for i in range(count, 0, -1):
        bounds[i] = bounds[i - 1]
    bounds[0] = 0


@inlined
def _on_limb(
    T_SL: tuple[Row, Row, Row], x: float, y: float, z: float, length: float, side: float
) -> tuple[float, float, float]:
    """u, y and z on the generic limb of a point of the link (eqs 4, 6), see `limb_coordinates` and
    `generic_limb_point`; NaN without a limb."""
    if length == 0.0:
        return np.nan, np.nan, np.nan
    a, b, c = T_SL
    x_S = a[0] * x + a[1] * y + a[2] * z + a[3]
    y_S = side * (b[0] * x + b[1] * y + b[2] * z + b[3])
    z_S = c[0] * x + c[1] * y + c[2] * z + c[3]
    r = np.sqrt(x_S * x_S + y_S * y_S)
    if r == 0.0:
        return -z_S / length, 0.0, RHO
    return -z_S / length, RHO * y_S / r, RHO * x_S / r


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
    for place in range(np.uint64(active)):
        seed = np.uint64(members[place])
        if label[seed] != 0:
            continue
        label[seed] = count + 1
        queue[_NONE] = members[place]
        done, size = _NONE, _ONE
        peak = force[seed]
        while done < size:
            taxel = np.uint64(queue[done])
            done += _ONE
            peak = max(peak, force[taxel])
            for edge in range(np.uint64(graph[taxel]), np.uint64(graph[taxel + _ONE])):
                other = np.uint64(graph[edge])
                if label[other] == 0 and force[other] >= floor:
                    label[other] = count + 1
                    queue[size] = graph[edge]
                    size += _ONE
        if peak >= touch:
            count += 1
            bounds[count] = bounds[count - 1] + np.int64(size)
        else:
            for i in range(size):
                label[np.uint64(queue[i])] = -1
    # All active taxels in their order, dealt to their clusters.
    for place in range(np.uint64(active)):
        queue[place] = members[place]
    _deal(queue[:active], label, bounds, members, count)
    return count


@compiled(int64(reads(1), float64, float64, reads(1, int32), writes(1, int32)))
def cluster(force: Array, floor: float, touch: float, graph: Indices, work: Indices) -> int:
    """Single-link clusters of taxels with `force` (n,) >= floor, those with one >= touch; their number.

    `work` (4 n + 1,) is memory that is zero before the first call. It holds then all members (n,), each
    cluster's in their order, the cluster of the first taxel first, and their bounds (n + 1,).
    """
    return _group(force, floor, touch, graph, work, _scan(force, floor, work[: len(force)]))


@compiled(int64(reads(1), float64, float64, reads(1, int32), reads(1, int32), writes(1, int32)))
def cluster_of(
    force: Array, floor: float, touch: float, active: Indices, graph: Indices, work: Indices
) -> int:
    """`cluster` where no other taxels than the `active` (k,) ones, in their order, feel anything."""
    found = _NONE
    for place in range(np.uint64(len(active))):
        if force[np.uint64(active[place])] >= floor:
            work[found] = active[place]
            found += _ONE
    return _group(force, floor, touch, graph, work, np.int64(found))


@inlined
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
    count: int,
    first: int,
    begin: int,
    numbers: Array,
    vectors: Array,
    indices: Indices,
    places: Array,
) -> None:
    """Fill in the `count` contacts that `cluster` found: from row `first` on `numbers` (c, NUMBERS) and
    `vectors` (c, VECTORS, 3), and from column `begin` on, of all their taxels (k,), the `indices` and the
    `places` (4, k): force [N], and u, y, z on the generic limb (eqs 3-4, 6).

    The link is at `T_TL` (4, 4), its limb's link at `T_TG`, `limb` (15,) at `posture` (4,) [rad], see
    `limb_pose`.
    """
    n = len(force)
    members, bounds = work[:n], work[n : 2 * n + 1]
    length, side = limb[12], limb[13]
    T_SL = limb_pose(T_TL, T_TG, limb, posture)
    for row in range(count):
        c = first + row
        total, peak, area = 0.0, 0.0, 0.0
        mean_x, mean_y, mean_z = 0.0, 0.0, 0.0
        for place in range(bounds[row], bounds[row + 1]):
            i = members[place]
            f = force[i]
            total += f
            peak = max(peak, f)
            area += taxels[i, 6]
            x, y, z = taxels[i, 0], taxels[i, 1], taxels[i, 2]
            mean_x += f * x
            mean_y += f * y
            mean_z += f * z
            indices[begin + place] = i
            u, y_L, z_L = _on_limb(T_SL, x, y, z, length, side)
            places[0, begin + place] = f
            places[1, begin + place] = u
            places[2, begin + place] = y_L
            places[3, begin + place] = z_L
        mean = mean_x / total, mean_y / total, mean_z / total
        nearest(mean, taxels, faces, box, cells, vectors[c, P_L], vectors[c, N_L])
        x, y, z = vectors[c, P_L, 0], vectors[c, P_L, 1], vectors[c, P_L, 2]
        nx, ny, nz = vectors[c, N_L, 0], vectors[c, N_L, 1], vectors[c, N_L, 2]
        for axis in range(3):
            n_T = T_TL[axis, 0] * nx + T_TL[axis, 1] * ny + T_TL[axis, 2] * nz
            at = T_TL[axis, 0] * x + T_TL[axis, 1] * y + T_TL[axis, 2] * z
            vectors[c, P_T, axis] = at + T_TL[axis, 3]
            vectors[c, N_T, axis] = n_T
            vectors[c, F_T, axis] = -total * n_T
        u, y_L, z_L = _on_limb(T_SL, x, y, z, length, side)
        numbers[c, FORCE] = total
        numbers[c, PEAK] = peak
        numbers[c, AREA] = area
        numbers[c, U] = u
        numbers[c, THETA] = np.arctan2(y_L, z_L)
        numbers[c, Y] = y_L
        numbers[c, Z] = z_L
