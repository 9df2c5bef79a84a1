"""Contacts of many worlds as Warp kernels: the loops of `tci.skin.kernels` (`contacts`, `nearest`), written a
second time in single precision. Tests tie both. The formulas are the same.
"""

from __future__ import annotations

import warp as wp

from tci.robot import formulas as _limbs
from tci.skin import formulas as _skin
from tci.support.one_source import made_with

wp.set_module_options({"enable_backward": False})
_l, _s = made_with(wp.func, _limbs, wp), made_with(wp.func, _skin, wp)
segment_axes = _l.segment_axes
variance_of, column_of, force_of = _s.variance_of, _s.column_of, _s.force_of
on_limb, precedes, corner_weights, wins = _s.on_limb, _s.precedes, _s.corner_weights, _s.wins
LAST = wp.constant(int(_skin.LAST))
ALIKE = wp.constant(1e-3)
"""`nearest.ALIKE` in single precision, whose ties differ by up to 1e-4."""
PLACES = 8
"""Room for contacts on one patch."""


@wp.struct
class Region:
    """One patch of skin, see `PATCH` of `sampling` and of `kernels.arrays`."""

    body: int
    begin: int
    end: int
    # Of the sensor: counts.
    node: int
    nodes: int
    per_count: float
    rest: float
    lowest: float
    highest: float
    sign: float
    # Grid of cells with faces.
    corner: wp.vec3
    per_metre: float
    cells_x: int
    cells_y: int
    cells_z: int
    cell: int
    # Limb segment.
    limb_body: int
    part: int
    length: float
    side: float
    segment: float
    origin: wp.vec3
    R_TM: wp.mat33


@wp.struct
class Touch:
    """One contact, as `tci.messages.contacts.CONTACT`; its taxels have the number `label`."""

    label: int
    force: float
    peak: float
    area: float
    u: float
    theta: float
    y: float
    z: float
    length: float
    p_L: wp.vec3
    n_L: wp.vec3
    p_T: wp.vec3
    n_T: wp.vec3
    # Pose of the link in the frame of the segment, for the places of taxels.
    R_SL: wp.mat33
    p_S: wp.vec3


@wp.struct
class Spot:
    """A point of a surface, with a normal of any length, and its squared distance."""

    p: wp.vec3
    n: wp.vec3
    far: float
    face: int


@wp.func
def nearer(
    point: wp.vec3, face: int, faces: wp.array2d(dtype=int), positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3), best: Spot,
) -> Spot:  # fmt: skip
    """The nearest point of a triangle of taxels, or `best` if that is nearer."""
    a = faces[face, 0]
    b = faces[face, 1]
    c = faces[face, 2]
    u = positions[b] - positions[a]
    v = positions[c] - positions[a]
    d = point - positions[a]
    s, t = corner_weights(wp.dot(u, u), wp.dot(u, v), wp.dot(v, v), wp.dot(d, u), wp.dot(d, v))
    off = d - s * u - t * v
    far = wp.dot(off, off)
    if wins(far, face, best.far, best.face, ALIKE):
        best.far = far
        best.face = face
        best.p = (1.0 - s - t) * positions[a] + s * positions[b] + t * positions[c]
        best.n = (1.0 - s - t) * normals[a] + s * normals[b] + t * normals[c]
    return best


@wp.func
def nearest(
    point: wp.vec3, one: Region, positions: wp.array(dtype=wp.vec3), normals: wp.array(dtype=wp.vec3),
    faces: wp.array2d(dtype=int), cells: wp.array(dtype=int),
) -> Spot:  # fmt: skip
    """`nearest.nearest`: the nearest point of the surface of a patch."""
    best = Spot()
    best.far = float(1e30)
    best.face = int(-1)
    nx = one.cells_x
    ny = one.cells_y
    nz = one.cells_z
    if nx * ny * nz == 0:
        for i in range(one.begin, one.end):
            d = positions[i] - point
            if wp.dot(d, d) < best.far:
                best.far = wp.dot(d, d)
                best.p = positions[i]
                best.n = normals[i]
        return best
    at = (point - one.corner) * one.per_metre
    cx = int(wp.floor(at[0]))
    cy = int(wp.floor(at[1]))
    cz = int(wp.floor(at[2]))
    last = wp.max(wp.max(wp.max(cx, nx - cx), wp.max(cy, ny - cy)), wp.max(cz, nz - cz)) + 1
    first = wp.max(
        wp.max(wp.max(0, -cx), wp.max(cx - nx + 1, -cy)), wp.max(wp.max(cy - ny + 1, -cz), cz - nz + 1)
    )
    x = at[0] - float(cx)
    y = at[1] - float(cy)
    z = at[2] - float(cz)
    margin = wp.min(wp.min(wp.min(x, 1.0 - x), wp.min(y, 1.0 - y)), wp.min(z, 1.0 - z))
    shell = int(first)
    searching = int(1)
    while searching == 1 and shell <= last:
        least = (float(shell - 1) + margin) / one.per_metre
        if shell > 0 and best.far <= least * least:
            searching = int(0)
        else:
            for i in range(wp.max(cx - shell, 0), wp.min(cx + shell, nx - 1) + 1):
                for j in range(wp.max(cy - shell, 0), wp.min(cy + shell, ny - 1) + 1):
                    step = wp.max(2 * shell, 1)
                    if wp.abs(i - cx) == shell or wp.abs(j - cy) == shell:
                        step = 1
                    k = int(cz - shell)
                    while k <= wp.min(cz + shell, nz - 1):
                        if k >= 0:
                            cell = one.cell + (i * ny + j) * nz + k
                            for entry in range(cells[cell], cells[cell + 1]):
                                best = nearer(point, cells[entry], faces, positions, normals, best)
                        k += step
            shell += 1
    return best


@wp.func
def summarise(
    w: int, label: int, seed: int, one: Region, positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3), areas: wp.array(dtype=float), fill: wp.array2d(dtype=float),
    hidden: wp.array(dtype=float), graph: wp.array(dtype=int), faces: wp.array2d(dtype=int),
    cells: wp.array(dtype=int), felt: wp.array2d(dtype=float), labels: wp.array2d(dtype=int),
) -> Touch:  # fmt: skip
    """`contacts._summarise`: the contact of the taxels with the `label`, in the frame of their link. `seed`
    is the first one."""
    out = Touch()
    out.label = label
    total = float(0.0)
    square = float(0.0)
    pressure = float(0.0)
    edge = float(0.0)
    taxels = float(0.0)
    own = float(0.0)
    beside = float(0.0)
    apart = float(0.0)
    mean = wp.vec3()
    centre = positions[seed]  # sums of squares around it keep their digits
    for i in range(seed, one.end):
        if labels[w, i] == label:
            f = felt[w, i]
            d = positions[i] - centre
            p = f / areas[i]
            total += f
            taxels += 1.0
            out.area += areas[i]
            out.peak = wp.max(out.peak, f)
            mean += f * d
            square += f * wp.dot(d, d)
            if p > pressure:
                pressure = p
                edge = hidden[i]
            for at in range(graph[i], graph[i + 1]):
                j = graph[at]
                way = positions[j] - positions[i]
                own += p * p
                apart += p * p * wp.dot(way, way)
                if labels[w, j] == label:
                    beside += p * felt[w, j] / areas[j]
    mean = mean / total
    column = column_of(
        variance_of(total, square, mean[0], mean[1], mean[2], own, beside, apart), out.area, taxels
    )
    low = wp.min(int(column), LAST - 1)
    part = column - float(low)
    filled = float(0.0)
    for i in range(seed, one.end):
        if labels[w, i] == label:
            filled += felt[w, i] * (fill[i, low] + part * (fill[i, low + 1] - fill[i, low]))
    out.force = force_of(total, filled, edge, pressure)
    spot = nearest(centre + mean, one, positions, normals, faces, cells)
    out.p_L = spot.p
    out.n_L = wp.normalize(spot.n)
    return out


@wp.kernel
def find(
    loaded: wp.array2d(dtype=int),
    regions: wp.array(dtype=Region),
    limits: wp.vec3,
    torso: int,
    T_LT: wp.mat44,
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    areas: wp.array(dtype=float),
    onset: wp.array(dtype=float),
    hidden: wp.array(dtype=float),
    fill: wp.array2d(dtype=float),
    graph: wp.array(dtype=int),
    faces: wp.array2d(dtype=int),
    cells: wp.array(dtype=int),
    posture: wp.array2d(dtype=wp.vec4),
    centres: wp.array2d(dtype=wp.vec3),
    turns: wp.array2d(dtype=wp.mat33),
    felt: wp.array2d(dtype=float),
    labels: wp.array2d(dtype=int),
    queue: wp.array2d(dtype=int),
    found: wp.array3d(dtype=Touch),
    counts: wp.array2d(dtype=int),
    full: wp.array(dtype=int),
):
    """`find_clusters` and `describe_clusters` of one patch of one world; `limits` [N] are those of `Limits`:
    least force on each taxel of a contact, of a light touch, and of a touch."""
    w, p = wp.tid()
    count = int(0)
    if loaded[w, p] == 0:
        counts[w, p] = 0
        return
    one = regions[p]
    for i in range(one.begin, one.end):
        labels[w, i] = 0
    label = int(0)
    for seed in range(one.begin, one.end):
        if felt[w, seed] > 0.0 and felt[w, seed] >= limits[0] and labels[w, seed] == 0:
            label += 1
            labels[w, seed] = label
            queue[w, one.begin] = seed
            done = int(one.begin)
            end = int(one.begin + 1)
            strong = int(0)
            while done < end:
                i = queue[w, done]
                done += 1
                f = felt[w, i]
                if f >= limits[2] or (f >= limits[1] and f >= onset[i] * areas[i]):
                    strong = int(1)
                for at in range(graph[i], graph[i + 1]):
                    j = graph[at]
                    if labels[w, j] == 0 and felt[w, j] > 0.0 and felt[w, j] >= limits[0]:
                        labels[w, j] = label
                        queue[w, end] = j
                        end += 1
            if strong == 1 and count == PLACES:
                wp.atomic_max(full, 0, w + 1)
            elif strong == 1:
                touch = summarise(
                    w, label, seed, one, positions, normals, areas, fill, hidden, graph, faces, cells, felt,
                    labels,
                )  # fmt: skip
                touch = placed(touch, w, one, torso, T_LT, posture, centres, turns)
                k = int(count)
                while k > 0 and precedes(
                    touch.force, touch.u, touch.theta, found[w, p, k - 1].force, found[w, p, k - 1].u,
                    found[w, p, k - 1].theta,
                ):  # fmt: skip
                    before = found[w, p, k - 1]
                    found[w, p, k] = before
                    k -= 1
                found[w, p, k] = touch
                count += 1
    counts[w, p] = count


@wp.func
def placed(
    touch: Touch, w: int, one: Region, torso: int, T_LT: wp.mat44, posture: wp.array2d(dtype=wp.vec4),
    centres: wp.array2d(dtype=wp.vec3), turns: wp.array2d(dtype=wp.mat33),
) -> Touch:  # fmt: skip
    """The contact with its place in the torso frame and on its limb."""
    R_LT = wp.mat33(
        T_LT[0, 0], T_LT[0, 1], T_LT[0, 2], T_LT[1, 0], T_LT[1, 1], T_LT[1, 2], T_LT[2, 0], T_LT[2, 1],
        T_LT[2, 2],
    )  # fmt: skip
    R = turns[w, torso] * R_LT  # torso and link in the world
    c = turns[w, torso] * wp.vec3(T_LT[0, 3], T_LT[1, 3], T_LT[2, 3]) + centres[w, torso]
    point = turns[w, one.body] * touch.p_L + centres[w, one.body]
    touch.length = one.length
    touch.p_T = wp.transpose(R) * (point - c)
    touch.n_T = wp.transpose(R) * (turns[w, one.body] * touch.n_L)
    touch.u = wp.nan
    touch.theta = wp.nan
    touch.y = wp.nan
    touch.z = wp.nan
    if one.length > 0.0:
        angles = posture[w, one.part]
        a, b, c0, d, e, f, g, h, i = segment_axes(
            angles[0], angles[1], angles[2], angles[3], one.side, one.segment
        )
        axes = wp.mat33(a, b, c0, one.side * d, one.side * e, one.side * f, g, h, i)
        axes = axes * (wp.transpose(one.R_TM) * wp.transpose(R))  # from the world
        start = turns[w, one.limb_body] * one.origin + centres[w, one.limb_body]
        touch.R_SL = axes * turns[w, one.body]
        touch.p_S = axes * (centres[w, one.body] - start)
        at = touch.R_SL * touch.p_L + touch.p_S
        u, y, z = on_limb(at[0], at[1], at[2], one.length)
        touch.u = u
        touch.y = y
        touch.z = z
        touch.theta = wp.atan2(y, z)
    return touch
