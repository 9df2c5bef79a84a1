"""Finds clusters of active taxels, and computes position, normal and force of each cluster (eqs 3-4, 6-7), in
compiled loops.
"""

from __future__ import annotations

import numpy as np
from numba import float64, from_dtype, int32, int64, void

from tci.messages.frames import Array
from tci.robot.kernels.limb import Row, limb_pose
from tci.skin import formulas
from tci.skin.formulas import LAST, LEAST_FILL
from tci.skin.kernels.arrays import (
    ACTIVE,
    CLUSTERS,
    CONTACTS,
    LAYOUT,
    LIMITS,
    ActiveTaxels,
    Clusters,
    ContactArrays,
    Indices,
    LayoutArrays,
    Limits,
    Records,
)
from tci.skin.kernels.nearest import nearest
from tci.support.compiled import compiled, inlined, reads, returns, writes
from tci.support.one_source import made_with

SUMMARY = np.dtype(
    [
        ("force", np.float64), ("peak", np.float64), ("area", np.float64), ("u", np.float64),
        ("theta", np.float64), ("y", np.float64), ("z", np.float64), ("point", np.float64, (3,)),
        ("normal", np.float64, (3,)),
    ],
    align=True,
)  # fmt: skip
"""What is computed of a contact in the frame of its link, before the contacts of a patch are sorted: force,
largest force on a taxel, area, place on the generic limb (u, theta, y, z), point on the surface and
normal."""
_f = made_with(inlined, formulas)
_variance, _column, _force = _f.variance_of, _f.column_of, _f.force_of
_place, _comes_first = _f.on_limb, _f.precedes
_NONE, _ONE = np.uint64(0), np.uint64(1)
"""0 and 1 as unsigned integers. For unsigned indices, Numba omits the check for negative indices."""


@inlined
def _deal(found: int, clusters: Clusters, count: int) -> None:
    """Writes the taxels of all clusters into `clusters.member`, and the forces on them into
    `clusters.member_force`, cluster by cluster. Sets the labels of the taxels to zero."""
    label, bound, member = clusters.label, clusters.bound, clusters.member
    for place in range(np.uint64(found)):
        taxel = np.uint64(clusters.queue[place])
        own = label[taxel]
        label[taxel] = 0
        if own > 0:
            cluster = np.uint64(own - 1)
            to = np.uint64(bound[cluster])
            member[to], clusters.member_force[to] = clusters.queue[place], clusters.force[taxel]
            bound[cluster] += 1
    # Filling has advanced each bound to the start of the next cluster.
    for i in range(count, 0, -1):
        bound[i] = bound[i - 1]
    bound[0] = 0


@inlined
def _grow(
    seed: int, limits: Limits, number: int, onset: Array, layout: LayoutArrays,
    clusters: Clusters,
) -> tuple[int, bool]:  # fmt: skip
    """Gives the label `number` to the taxel `seed`, and to all pressed taxels that a chain of pressed
    neighbours connects with this taxel.

    Returns the number of labelled taxels, and True if at least one of them is pressed strongly enough for a
    contact.
    """
    force, label, queue, graph = clusters.force, clusters.label, clusters.queue, layout.graph
    done, size = _NONE, _ONE
    label[np.uint64(seed)], queue[_NONE], strong = number, seed, False
    while done < size:
        taxel = np.uint64(queue[done])
        done += _ONE
        f = force[taxel]
        strong |= f >= limits.touch or (f >= limits.light and f >= onset[taxel] * layout.taxels[taxel].area)
        for edge in range(np.uint64(graph[taxel]), np.uint64(graph[taxel + _ONE])):
            other = np.uint64(graph[edge])
            if label[other] == 0 and force[other] >= limits.floor:
                label[other], queue[size] = number, graph[edge]
                size += _ONE
    return int(size), strong


@inlined
def find_clusters(
    state: ActiveTaxels, limits: Limits, onset: Array, layout: LayoutArrays, clusters: Clusters
) -> tuple[int, int, int]:
    """Finds clusters of neighbouring active taxels, and writes them to `clusters`. Two active neighbours are
    always in one cluster (single linkage).

    Only taxels with a force of at least `limits.floor` [N] are used. In each cluster, one taxel must have a
    force of at least `limits.touch` [N], or a force of at least `limits.light` [N] and a pressure of at least
    `onset` (n,) [Pa]. Returns the number of clusters, the number of their taxels, and the number of clusters
    of a single taxel.
    """
    floor = limits.floor
    count, force, queue = 0, clusters.force, clusters.queue
    clusters.bound[0] = 0
    for p in range(len(clusters.counts)):
        begin = layout.patches[p].taxel
        for k in range(state.begin[p], state.begin[p + 1]):
            i = begin + state.active[k]
            force[i] = state.pressure[k] * layout.taxels[i].area
    for p in range(len(clusters.counts)):
        begin, before = layout.patches[p].taxel, count
        for k in range(state.begin[p], state.begin[p + 1]):
            seed = begin + state.active[k]
            if force[seed] < floor or clusters.label[seed] != 0:
                continue
            size, strong = _grow(seed, limits, count + 1, onset, layout, clusters)
            if strong:
                count += 1
                clusters.bound[count] = clusters.bound[count - 1] + size
            else:
                for place in range(size):
                    clusters.label[np.uint64(queue[place])] = -1
        clusters.counts[p] = count - before
    found = 0
    for p in range(len(clusters.counts)):
        for k in range(state.begin[p], state.begin[p + 1]):
            i = layout.patches[p].taxel + state.active[k]
            if force[i] >= floor:
                queue[found] = i
                found += 1
    _deal(found, clusters, count)
    for p in range(len(clusters.counts)):
        for k in range(state.begin[p], state.begin[p + 1]):
            force[layout.patches[p].taxel + state.active[k]] = 0.0
    single = 0
    for c in range(count):
        single += clusters.bound[c + 1] - clusters.bound[c] == 1
    return count, clusters.bound[count], single


@compiled(returns(int64, int64, int64)(ACTIVE, LIMITS, reads(1), LAYOUT, CLUSTERS))
def cluster(
    state: ActiveTaxels, limits: Limits, onset: Array, layout: LayoutArrays, clusters: Clusters
) -> tuple[int, int, int]:
    """`find_clusters`, to be called from Python."""
    return find_clusters(state, limits, onset, layout, clusters)


@inlined
def _on_limb(
    T_SL: tuple[Row, Row, Row], x: float, y: float, z: float, length: float, side: float
) -> tuple[float, float, float]:
    """Projects a point (x, y, z) [m] in the frame of a patch's link to the surface of the generic limb, and
    returns its coordinates (u, y, z) there, in limb lengths (eqs 4, 6).

    All three are NaN if the patch is on no limb.
    """
    if length == 0.0:
        return np.nan, np.nan, np.nan
    a, b, c = T_SL
    x_S = a[0] * x + a[1] * y + a[2] * z + a[3]
    y_S = side * (b[0] * x + b[1] * y + b[2] * z + b[3])
    z_S = c[0] * x + c[1] * y + c[2] * z + c[3]
    place: tuple[float, float, float] = _place(x_S, y_S, z_S, length)
    return place


@inlined
def _filled(taxels: Indices, forces: Array, room: Array, layout: LayoutArrays) -> float:
    """Returns the sum over the pressed taxels `taxels` (k,) of the force [N] on each, in `forces` (k,), times
    the fill factor around it. `room` (n,) is zero, before and after."""
    places, fill, graph = layout.taxels, layout.fill, layout.graph
    total, area, x, y, z, square = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(taxels)):
        one, f = places[np.uint64(taxels[k])], forces[k]
        a, b, c = one.position[0], one.position[1], one.position[2]
        total, area = total + f, area + one.area
        x, y, z = x + f * a, y + f * b, z + f * c
        square += f * (a * a + b * b + c * c)
        room[np.uint64(taxels[k])] = f / one.area
    own, beside, apart = 0.0, 0.0, 0.0
    for k in range(len(taxels)):
        i = np.uint64(taxels[k])
        here, p = places[i].position, room[i]
        for edge in range(np.uint64(graph[i]), np.uint64(graph[i + _ONE])):
            j = np.uint64(graph[edge])
            there = places[j].position
            own, beside = own + p * p, beside + p * room[j]
            apart += (
                p * p * ((here[0] - there[0]) ** 2 + (here[1] - there[1]) ** 2 + (here[2] - there[2]) ** 2)
            )
    for k in range(len(taxels)):
        room[np.uint64(taxels[k])] = 0.0
    x, y, z = x / total, y / total, z / total
    column = _column(_variance(total, square, x, y, z, own, beside, apart), area, float(len(taxels)))
    low = np.uint64(min(int(column), int(LAST) - 1))
    part, filled = column - low, 0.0
    for k in range(len(taxels)):
        i = np.uint64(taxels[k])
        filled += forces[k] * (fill[i, low] + part * (fill[i, low + _ONE] - fill[i, low]))
    return filled


@compiled(float64(reads(1, int32), reads(1), writes(1), LAYOUT), seldom=True)
def fill_around(taxels: Indices, forces: Array, room: Array, layout: LayoutArrays) -> float:
    """Returns the fraction of a touch's force that `taxels` (k,) measure: the fill factor around the touch.

    `taxels` are indices within the whole skin, and `forces` (k,) the forces on these taxels, in any unit.
    `room` (n,) is zero for all taxels of the skin.
    """
    return max(_filled(taxels, forces, room, layout) / forces.sum(), LEAST_FILL)


@inlined
def _summarise(
    c: int, p: int, T_SL: tuple[Row, Row, Row], hidden: Array, layout: LayoutArrays, clusters: Clusters,
    row: Records,
) -> None:  # fmt: skip
    """Writes the contact that belongs to cluster `c` on patch `p` into `row`, a record of type `SUMMARY`."""
    total, peak, area, pressure, edge = 0.0, 0.0, 0.0, 0.0, 0.0
    mean_x, mean_y, mean_z = 0.0, 0.0, 0.0
    for place in range(clusters.bound[c], clusters.bound[c + 1]):
        i, f = clusters.member[place], clusters.member_force[place]
        total += f
        peak = max(peak, f)
        taxel = layout.taxels[i]
        area += taxel.area
        if f > pressure * taxel.area:
            pressure, edge = f / taxel.area, hidden[i]
        mean_x += f * taxel.position[0]
        mean_y += f * taxel.position[1]
        mean_z += f * taxel.position[2]
    mean = mean_x / total, mean_y / total, mean_z / total
    begin, end = clusters.bound[c], clusters.bound[c + 1]
    filled = _filled(clusters.member[begin:end], clusters.member_force[begin:end], clusters.force, layout)
    row.force = _force(total, filled, edge, pressure)
    row.peak, row.area = peak, area
    nearest(mean, p, layout, row.point, row.normal)
    x, y, z = row.point[0], row.point[1], row.point[2]
    limb = layout.patches[p].limb
    u, y_L, z_L = _on_limb(T_SL, x, y, z, limb.length, limb.side)
    row.u, row.theta, row.y, row.z = u, np.arctan2(y_L, z_L), y_L, z_L


@inlined
def _write(p: int, row: Records, T_TL: Array, to: Records) -> None:
    """Writes a contact of patch `p`, except for its taxels, into the record `to`. `row` contains the contact
    in the frame of the link."""
    to.site, to.force, to.peak, to.area = p, row.force, row.peak, row.area
    to.u, to.theta, to.certainty = row.u, row.theta, 1.0
    to.limb_point[0], to.limb_point[1], to.limb_point[2] = row.u, row.y, row.z
    x, y, z = row.point[0], row.point[1], row.point[2]
    nx, ny, nz = row.normal[0], row.normal[1], row.normal[2]
    for axis in range(3):
        to.p_L[axis], to.n_L[axis] = row.point[axis], row.normal[axis]
        n_T = T_TL[axis, 0] * nx + T_TL[axis, 1] * ny + T_TL[axis, 2] * nz
        at = T_TL[axis, 0] * x + T_TL[axis, 1] * y + T_TL[axis, 2] * z
        to.p_T[axis] = at + T_TL[axis, 3]
        to.n_T[axis] = n_T
        to.f_T[axis] = -row.force * n_T


@inlined
def _write_taxels(
    c: int, p: int, found: int, T_SL: tuple[Row, Row, Row], layout: LayoutArrays, clusters: Clusters,
    out: ContactArrays,
) -> None:  # fmt: skip
    """Writes the taxels of contact `c` into `out`: index within the patch `p`, force [N] and place on the
    generic limb. `found` is the index of the contact's cluster in `clusters`."""
    to, patch = out.begin[c], layout.patches[p]
    for place in range(clusters.bound[found], clusters.bound[found + 1]):
        i = clusters.member[place]
        one = out.taxels[to]
        one.taxel, one.taxel_force = i - patch.taxel, clusters.member_force[place]
        at = layout.taxels[i].position
        u, y, z = _on_limb(T_SL, at[0], at[1], at[2], patch.limb.length, patch.limb.side)
        one.taxel_point[0], one.taxel_point[1], one.taxel_point[2] = u, y, z
        to += 1
    out.begin[c + 1] = to


@inlined
def describe_clusters(
    layout: LayoutArrays, hidden: Array, clusters: Clusters, poses: Array, posture: Array, summary: Records,
    out: ContactArrays,
) -> None:  # fmt: skip
    """Computes the contact of each cluster (eqs 3-4, 6-7) and writes it to `out`. On each patch the strongest
    contact is first.

    A contact consists of its force, its centre of pressure on the surface, the normal at this centre, and its
    place on the generic limb. The force includes an estimate for the edge of the touch, where the pressure is
    below `hidden` (n,) [Pa] and so not measured. `poses` (l, 4, 4) are the poses of the links in the torso
    frame. `posture` (parts, 4) [rad] are the first four generic angles of each limb. `summary` (c,)
    is work space, with records of type `SUMMARY`.
    """
    c, order = 0, out.rows.identity
    out.begin[0] = 0
    for p in range(len(clusters.counts)):
        first = c
        c += clusters.counts[p]
        if c == first:
            continue
        patch = layout.patches[p]
        T_TL = poses[patch.link]
        T_SL = limb_pose(T_TL, poses[patch.limb_link], patch.limb, posture[patch.part])
        for found in range(first, c):
            _summarise(found, p, T_SL, hidden, layout, clusters, summary[found])
            k = found
            own = summary[found]
            while k > first:
                other = summary[order[k - 1]]
                if not _comes_first(own.force, own.u, own.theta, other.force, other.u, other.theta):
                    break
                order[k] = order[k - 1]
                k -= 1
            order[k] = found
        for k in range(first, c):
            found = order[k]
            _write(p, summary[found], T_TL, out.rows[k])
            _write_taxels(k, p, found, T_SL, layout, clusters, out)


@compiled(void(LAYOUT, reads(1), CLUSTERS, reads(3), reads(2), writes(1, from_dtype(SUMMARY)), CONTACTS))
def describe(
    layout: LayoutArrays, hidden: Array, clusters: Clusters, poses: Array, posture: Array, summary: Records,
    out: ContactArrays,
) -> None:  # fmt: skip
    """`describe_clusters`, to be called from Python."""
    describe_clusters(layout, hidden, clusters, poses, posture, summary, out)
