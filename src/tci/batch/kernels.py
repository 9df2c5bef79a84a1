"""Servos and finger of many worlds as Warp kernels: the loops of `tci.simulation.stepping`, written a second
time in single precision. Tests tie both.
"""

from __future__ import annotations

import warp as wp

from tci.batch import formulas
from tci.batch.limiter import PIECES as _PIECES
from tci.support.one_source import made_with

wp.set_module_options({"enable_backward": False})
_f = made_with(wp.func, formulas)
side_of, rise_of, hold_of, fall_of = _f.side_of, _f.rise_of, _f.hold_of, _f.fall_of
is_eased, ease_of, speed_of, over_peak = _f.is_eased, _f.ease_of, _f.speed_of, _f.over_peak
PIECES = wp.constant(_PIECES)


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
