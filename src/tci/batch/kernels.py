"""Servos, finger and skin of many worlds as Warp kernels: the loops of `tci.simulation` (`stepping`,
`kernel`, `sampling`), written a second time in single precision. Tests tie both.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from tci.batch import formulas
from tci.batch.limiter import PIECES as _PIECES
from tci.simulation.kernel import REACH as _REACH
from tci.simulation.sampling import FORCE, NORMAL, POSITION
from tci.simulation.sampling import NUMBERS as _NUMBERS
from tci.simulation.sampling import SIDE as _SIDE
from tci.simulation.sampling import SLOTS as _SLOTS

wp.set_module_options({"enable_backward": False})
_f = formulas.made_with(wp.func)
side_of, rise_of, hold_of, fall_of = _f.side_of, _f.rise_of, _f.hold_of, _f.fall_of
is_eased, ease_of, speed_of, over_peak = _f.is_eased, _f.ease_of, _f.speed_of, _f.over_peak
Sums = wp.types.vector(length=8, dtype=wp.float32)
REACH, SIDE = wp.constant(_REACH), wp.constant(_SIDE)
SLOTS, NUMBERS, PIECES = wp.constant(_SLOTS), wp.constant(_NUMBERS), wp.constant(_PIECES)
AT_FORCE, AT_POSITION, AT_NORMAL = wp.constant(FORCE), wp.constant(POSITION), wp.constant(NORMAL)
SOFTNESS, TOLERANCE = wp.constant(0.02), wp.constant(1e-4)
STEPS = wp.constant(30)
LANES = 32
"""Threads that share the taxels around one contact: a warp of the GPU."""
SLACK = wp.constant(4e-6)
"""Share of its value by which the function may grow in a search: about its rounding in single precision,
below which no step would ever be accepted."""


@wp.struct
class Servo:
    """Of one moving joint, see `stepping.DRIVE`."""

    lag: float
    ratio: float
    shift: float
    top: float
    servo: int
    address: int
    actuator: int


@wp.struct
class Poke:
    """Of the finger of one world, see `stepping.POKE`; times in double precision."""

    begin: wp.float64
    active: int
    speed: float
    depth: float
    path: float
    end: float
    force: float
    peak: float
    touched: int


@wp.struct
class Patch:
    """One patch of skin, see `sampling.PATCH`."""

    sensor: int
    body: int
    begin: int
    end: int
    width: float


@wp.kernel
def limit(
    period: float,
    wanted: wp.array2d(dtype=float),
    limits: wp.array2d(dtype=float),
    goals: wp.array2d(dtype=float),
    states: wp.array2d(dtype=wp.vec3),
    times: wp.array3d(dtype=float),
    jerks: wp.array3d(dtype=float),
):
    """`limiter.advance` of one servo of one world; `limits` (5, n) as there."""
    w, i = wp.tid()
    state = states[w, i]
    fastest = limits[2, i]
    most = limits[3, i]
    jerk = limits[4, i]
    asked = wanted[w, i]
    if jerk > 0.0 and asked == asked:
        target = wp.clamp(asked, limits[0, i], limits[1, i])
        if target != goals[w, i]:
            goals[w, i] = target
            sign = float(1.0)
            if state[2] > 0.0:
                sign = float(-1.0)
            d = sign * (target - state[0])
            v = sign * state[1]
            a = sign * state[2]
            for k in range(PIECES):
                times[w, i, k] = 0.0
                jerks[w, i, k] = 0.0
            first = float(v)
            from_a = float(a)
            peak = float(0.0)
            if is_eased(d, v, a, most, jerk):
                eased = ease_of(d, v, a, most, jerk)
                t = (eased - a) / jerk
                times[w, i, 0] = t
                jerks[w, i, 0] = sign * jerk
                first = v + t * (a + t * jerk / 2.0)
                from_a = eased
            else:
                peak = speed_of(d, v, a, fastest, most, jerk)
                if wp.abs(peak) > 0.5 * fastest:
                    times[w, i, 4] = wp.max((d - over_peak(v, a, peak, most, jerk)) / peak, 0.0)
                side = side_of(peak, 0.0, 0.0, jerk)
                times[w, i, 5] = rise_of(peak, 0.0, 0.0, most, jerk)
                times[w, i, 6] = hold_of(peak, 0.0, 0.0, most, jerk)
                times[w, i, 7] = fall_of(peak, 0.0, 0.0, most, jerk)
                jerks[w, i, 5] = sign * side * jerk
                jerks[w, i, 7] = -sign * side * jerk
            side = side_of(first, from_a, peak, jerk)
            times[w, i, 1] = rise_of(first, from_a, peak, most, jerk)
            times[w, i, 2] = hold_of(first, from_a, peak, most, jerk)
            times[w, i, 3] = fall_of(first, from_a, peak, most, jerk)
            jerks[w, i, 1] = sign * side * jerk
            jerks[w, i, 3] = -sign * side * jerk
    left = float(period)
    p = state[0]
    v = state[1]
    a = state[2]
    for k in range(PIECES):
        t = wp.min(left, times[w, i, k])
        if t > 0.0:
            j = jerks[w, i, k]
            p = p + t * (v + t * (a / 2.0 + t * j / 6.0))
            v = v + t * (a + t * j / 2.0)
            a = a + t * j
            times[w, i, k] = times[w, i, k] - t
            left = left - t
    if left > 0.0:
        p = goals[w, i]
        v = float(0.0)
        a = float(0.0)
    states[w, i] = wp.vec3(p, v, a)


@wp.kernel
def aim(
    steps: float,
    servos: wp.array(dtype=Servo),
    states: wp.array2d(dtype=wp.vec3),
    drives: wp.array2d(dtype=wp.vec3),
):
    """`loops.aim` of one joint of one world; `drives` (N, k) are set-point, stride and advance."""
    w, i = wp.tid()
    one = servos[i]
    target = states[w, one.servo][0] * one.ratio + one.shift
    drive = drives[w, i]
    drives[w, i] = wp.vec3(drive[0], wp.min(wp.abs(target - drive[0]) / steps, one.top), drive[2])


@wp.kernel
def prepare(
    servos: wp.array(dtype=Servo),
    states: wp.array2d(dtype=wp.vec3),
    qpos: wp.array2d(dtype=float),
    drives: wp.array2d(dtype=wp.vec3),
    ctrl: wp.array2d(dtype=float),
):
    """`stepping.follow` and `stepping.drive` of one joint of one world."""
    w, i = wp.tid()
    one = servos[i]
    drive = drives[w, i]
    target = states[w, one.servo][0] * one.ratio + one.shift
    advance = wp.clamp(target - drive[0], -drive[1], drive[1])
    here = qpos[w, one.address]
    ctrl[w, one.actuator] = here + wp.clamp(drive[0] + advance - here, -one.lag, one.lag)
    drives[w, i] = wp.vec3(drive[0] + advance, drive[1], advance)


@wp.kernel
def push(
    step: wp.float64,
    number: wp.array(dtype=int),
    actuator: int,
    leads: float,
    pokes: wp.array(dtype=Poke),
    ctrl: wp.array2d(dtype=float),
):
    """`stepping.push` of one world."""
    w = wp.tid()
    one = pokes[w]
    if one.active == 0:
        return
    wanted = one.speed * float(step * wp.float64(number[0]) - one.begin)
    one.path = wp.max(one.path, wp.min(wanted, one.end))
    speed = float(0.0)
    if wanted < one.end:
        speed = one.speed
    ctrl[w, actuator] = one.path + leads * speed
    pokes[w] = one


@wp.kernel
def note(
    step: wp.float64,
    number: wp.array(dtype=int),
    sensor: int,
    sensors: wp.array2d(dtype=float),
    pokes: wp.array(dtype=Poke),
):
    """`stepping.note_tip` of one world, without a record."""
    w = wp.tid()
    one = pokes[w]
    if one.active == 0:
        return
    f = wp.vec3(sensors[w, sensor], sensors[w, sensor + 1], sensors[w, sensor + 2])
    one.force = wp.length(f)
    if one.force > 0.0:
        if one.touched == 0:
            one.touched = 1
            one.end = one.path + one.depth
            time = step * wp.float64(number[0])
            one.begin = wp.max(one.begin, time - wp.float64(one.path) / wp.float64(one.speed))
        one.peak = wp.max(one.peak, one.force)
    pokes[w] = one


@wp.kernel
def count(number: wp.array(dtype=int)):
    number[0] = number[0] + 1


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
