"""Skin of many worlds as Warp kernels: the loops of `tci.simulation` (`kernel`, `sampling`), written a second
time in single precision. Tests tie both.

The file stands alone: `packages/mjlab_tci` contains it too, where TCI and its MuJoCo can't be.
"""

from __future__ import annotations

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})
Sums = wp.types.vector(length=8, dtype=wp.float32)
# As in `kernel` and `sampling`.
SLOTS, NUMBERS = wp.constant(16), wp.constant(13)
AT_FORCE, AT_POSITION, AT_NORMAL = wp.constant(1), wp.constant(4), wp.constant(7)
REACH, SIDE = wp.constant(6.0), wp.constant(0.2)
SOFTNESS, TOLERANCE, STEPS = wp.constant(0.02), wp.constant(1e-4), wp.constant(30)
LANES = 32
"""Threads that share the taxels around one contact: a warp of the GPU."""
SLACK = wp.constant(4e-6)
"""Share of its value by which the function may grow in a search: about its rounding in single precision,
below which no step would ever be accepted."""


@wp.struct
class Patch:
    """One patch of skin, see `sampling.PATCH`."""

    sensor: int
    body: int
    begin: int
    end: int
    width: float


@wp.func
def weigh(
    lane: int,
    positions: wp.array(dtype=wp.vec3),
    begin: int,
    end: int,
    point: wp.vec3,
    a: wp.vec3,
    b: wp.vec3,
    scale: float,
    least: float,
    furthest: float,
    u: float,
    v: float,
) -> Sums:
    """`kernel._weigh`: six sums over the taxels, the value that the best u and v minimise, and the largest
    logarithm. All lanes of a block share the taxels, and get the same result."""
    own = float(-1e30)
    for k in range(begin + lane, end, wp.block_dim()):
        d = positions[k] - point
        s = wp.dot(d, d) * scale
        if s <= furthest:
            own = wp.max(own, -0.5 * (s - least) + wp.dot(d, a) * u + wp.dot(d, b) * v)
    top = wp.tile_reduce(wp.max, wp.tile(own))[0]
    part = Sums()
    for k in range(begin + lane, end, wp.block_dim()):
        d = positions[k] - point
        s = wp.dot(d, d) * scale
        if s <= furthest:
            x = wp.dot(d, a)
            y = wp.dot(d, b)
            w = wp.exp(-0.5 * (s - least) + x * u + y * v - top)
            part[0] += w
            part[1] += w * x
            part[2] += w * y
            part[3] += w * x * x
            part[4] += w * x * y
            part[5] += w * y * y
    sums = wp.tile_reduce(wp.add, wp.tile(part, preserve_type=True))[0]
    sums[6] = top + wp.log(sums[0]) + 0.5 * SOFTNESS * (u * u + v * v)
    sums[7] = top
    return sums


@wp.kernel
def clear(due: wp.array(dtype=int), owner: wp.array(dtype=int), force: wp.array2d(dtype=float)):
    """Removes the forces on the taxels of the patches that are `due` (p,)."""
    w, k = wp.tid()
    if due[owner[k]] != 0:
        force[w, k] = 0.0


@wp.kernel
def feel(
    due: wp.array(dtype=int),
    patches: wp.array(dtype=Patch),
    sensors: wp.array2d(dtype=float),
    centres: wp.array2d(dtype=wp.vec3),
    turns: wp.array2d(dtype=wp.mat33),
    positions: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    force: wp.array2d(dtype=float),
    full: wp.array(dtype=int),
):
    """`sampling.press` for one contact of one patch of one world: adds its force [N] to the taxels, which
    the lanes of a block share."""
    w, p, slot, lane = wp.tid()
    one = patches[p]
    found = int(sensors[w, one.sensor])
    if due[p] == 0 or slot >= found:
        return
    if found > SLOTS:
        wp.atomic_max(full, 0, w + 1)
        return
    at = one.sensor + NUMBERS * slot
    R = wp.transpose(turns[w, one.body])
    pressing = sensors[w, at + AT_FORCE]
    i = at + AT_POSITION
    point = R * (wp.vec3(sensors[w, i], sensors[w, i + 1], sensors[w, i + 2]) - centres[w, one.body])
    i = at + AT_NORMAL
    m = R * wp.vec3(sensors[w, i], sensors[w, i + 1], sensors[w, i + 2])
    scale = 1.0 / (one.width * one.width)
    own = float(1e30)
    for k in range(one.begin + lane, one.end, wp.block_dim()):
        d = positions[k] - point
        own = wp.min(own, wp.dot(d, d) * scale)
    least = wp.tile_reduce(wp.min, wp.tile(own))[0]
    furthest = (wp.sqrt(least) + REACH) * (wp.sqrt(least) + REACH)
    x = wp.abs(m[0])
    y = wp.abs(m[1])
    z = wp.abs(m[2])
    a = wp.vec3(m[1], -m[0], 0.0)
    if x <= y and x <= z:
        a = wp.vec3(0.0, m[2], -m[1])
    elif y <= z:
        a = wp.vec3(-m[2], 0.0, m[0])
    a = a / (one.width * wp.length(a))
    b = wp.cross(m, a)
    u = float(0.0)
    v = float(0.0)
    s = weigh(lane, positions, one.begin, one.end, point, a, b, scale, least, furthest, u, v)
    searching = int(1)
    n = int(0)
    while searching == 1 and n < STEPS:
        n += 1
        gx = s[1] / s[0]
        gy = s[2] / s[0]
        g = gx + SOFTNESS * u
        h = gy + SOFTNESS * v
        if g * g + h * h < TOLERANCE * TOLERANCE:
            searching = int(0)
        else:
            xx = s[3] / s[0] - gx * gx + SOFTNESS
            xy = s[4] / s[0] - gx * gy
            yy = s[5] / s[0] - gy * gy + SOFTNESS
            det = xx * yy - xy * xy
            du = (xy * h - yy * g) / det
            dv = (xy * g - xx * h) / det
            slope = g * du + h * dv
            size = float(1.0)
            better = int(0)
            trial = Sums()
            while size > 1e-6 and better == 0:
                trial = weigh(
                    lane, positions, one.begin, one.end, point, a, b, scale, least, furthest, u + size * du,
                    v + size * dv,
                )  # fmt: skip
                if trial[6] <= s[6] + 1e-4 * size * slope + SLACK * (1.0 + wp.abs(s[6])):
                    better = int(1)
                else:
                    size = size * 0.5
            if better == 0:
                searching = int(0)
            else:
                u = u + size * du
                v = v + size * dv
                s = trial
    # How directly the skin there faces the contact.
    facing = float(0.0)
    for k in range(one.begin + lane, one.end, wp.block_dim()):
        d = positions[k] - point
        q = wp.dot(d, d) * scale
        if q <= furthest:
            share = wp.exp(-0.5 * (q - least) + wp.dot(d, a) * u + wp.dot(d, b) * v - s[7]) / s[0]
            facing = facing + share * wp.dot(normals[k], m)
    cosine = wp.tile_reduce(wp.add, wp.tile(facing))[0]
    if cosine < SIDE:
        return
    for k in range(one.begin + lane, one.end, wp.block_dim()):
        d = positions[k] - point
        q = wp.dot(d, d) * scale
        if q <= furthest:
            share = wp.exp(-0.5 * (q - least) + wp.dot(d, a) * u + wp.dot(d, b) * v - s[7]) / s[0]
            wp.atomic_add(force, w, k, pressing * share)


def structs(kind: Any, rows: list[dict[str, Any]], device: Any) -> Any:
    """An array of Warp structs with the fields of `rows`."""
    made = []
    for row in rows:
        one = kind()
        for name, value in row.items():
            setattr(one, name, value)
        made.append(one)
    return wp.array(made, dtype=kind, device=device)
