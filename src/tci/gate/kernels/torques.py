"""Torques of servos in torque mode, in one compiled loop that `tci.gate.torque` calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, record, views, writes


class Limits(NamedTuple):
    """Limits of k servos in torque mode, each (k,)."""

    lower: Array
    """Least angles [rad]."""
    upper: Array
    """Largest angles [rad]."""
    velocity: Array
    """Largest speeds [rad/s]."""
    creep: Array
    """Speeds [rad/s] at which servos outside their limits return."""
    acceleration: Array
    """Largest accelerations [rad/s2]."""
    approach: Array
    """Decelerations [rad/s2] that are assumed to be available before a limit."""
    torque: Array
    """Largest torques [N m]."""
    inertia: Array
    """Least inertias [kg m2] of what the servos move."""


class Measured(NamedTuple):
    """What was measured of all servos, each (n_servos,)."""

    position: Array
    """Angles [rad]."""
    speed: Array
    """Measured velocities [rad/s]."""
    slope: Array
    """Mean speeds [rad/s], computed from angles; NaN if unknown."""
    since_speed: Array
    """Torque times duration [N m s] that was sent since `speed` was measured."""
    since_slope: Array
    """Torque times duration [N m s] that was sent since `slope` was measured."""
    between: Array
    """Torque times duration [N m s] that acted between the reading before and this one."""


class Times(NamedTuple):
    """Times of one period [s]."""

    age: float
    """Age of the measured speeds."""
    half: float
    """Time by which the mean speeds are older."""
    elapsed: float
    """Time between this reading and the one before; 0 if no new reading came."""
    underway: float
    """Time from a torque's computation to its effect."""
    period: float
    """Period of the control loop."""


class Memory(NamedTuple):
    """What is kept of all servos from one period to the next, each (n_servos,)."""

    wanted: Array
    """Commanded torques [N m]."""
    risen: Array
    """Torques [N m] that approach the commanded torques gradually."""
    given: Array
    """Torques [N m] that are sent."""
    load: Array
    """Torques [N m] that something else seems to exert: what holds a joint, its weight, its friction, its
    neighbours, and the part of the servo's own torque that a motor with more inertia takes."""
    before: Array
    """Velocities [rad/s] of the reading before."""


class Answers(NamedTuple):
    """What is kept of all servos to tell whether their readings answer the torques, each (n_servos,)."""

    place: Array
    """Angles [rad] of the reading before."""
    stood: Array
    """Times [s] for which angle and velocity have repeated exactly."""
    base: Array
    """Torques [N m] under which they began to repeat."""
    pace: Array
    """Speeds [rad/s] that what was added since then would have given a joint that is free."""
    heavy: Array
    """Speeds [rad/s] that it would have given a joint that is heavy and sticks."""
    way: Array
    """Ways [rad] that such a joint would have gone."""
    spent: Array
    """Times [s] since it would have turned far enough to be noticed."""
    tried: Array
    """Largest torques [N m] that were added."""
    unanswered: Array
    """Torques [N m] that were added and that no reading answered in time; else 0."""
    withheld: Array
    """Torques [N m] up to `push` that are not sent any more; else 0."""


UNSEEN, MORE = 0.6, 0.3
"""Shares of its speed limit that a free joint may get while its readings repeat: by a torque up to `push`,
and in addition by a larger one. With double of both it would pass its limit; with half, a joint that rests
gets what was asked for half as long."""
SLEEPS, STRONGEST = 0.06, 2.0
"""Time [s] for which a reading repeats exactly until no more than this multiple of `push` is added."""
HEAVY = 4.0
"""Inertia, as a multiple of the links' least, up to which a free joint must answer: with its motor."""
NOTICED = float(np.deg2rad(0.25))
"""Way [rad] of such a joint after which a reading must differ: more than a count of a coarse encoder."""
PATIENCE = 0.1
"""Time [s] by which its readings may come later than they do."""
RISE = 0.02
"""Time [s] in which a torque may rise from zero to its limit. Assumed: a sudden change of torque would jerk
the joint."""
SETTLE = 2.0
"""A joint slows down so early before a limit that it can settle: by this number of delays of its
measurements. Assumed: with a smaller value, joints overshoot their limits."""
FADE = float(np.deg2rad(2.0))
"""Distance [rad] from a limit below which a torque towards the limit decreases to zero. Assumed: with a
shorter distance, joints are pushed into their limits; with a longer distance, more of their range is lost."""
SLOW = float(np.deg2rad(3.0))
"""Speed [rad/s] from which a brake also holds against what drives the joint. Below it this share is in
proportion to the speed, so that a joint at rest never presses against somebody."""
LEARN, MOVING, UNLEARN = 0.1, 0.25, 0.012
"""Time constants [s] with which a load that opposes the torque is believed while the joint stands and while
it moves, and with which it is believed that a load is less, or drives the joint. On iCub's arms, with hostile
torques on all joints, half of the first two lets true speeds exceed the limit for 60 ms instead of 15, and
with double of them a held joint gets half of its torque after 2 s instead of 1. With half of the last one
joints whose torques arrive sooner than assumed swing up to 2.4 times their limit."""
BACK = float(np.deg2rad(3.0))
"""Speed [rad/s] at which links that came too near each other part again."""
HELD = 0.1
"""Fraction of the torque limit up to which a joint that goes back from another link is held against what
drives it there. The weight that a firmware with wrong masses leaves is less."""
STANDS = 0.1
"""Fraction of its speed limit below which a joint stands."""
UNSURE = 0.15
"""If angles tell a speed that is larger than the measured velocity by this fraction of the speed limit, no
load is believed: the joint moves and its velocity does not show it."""


@inlined
def add_with_care(
    i: int, given: float, push: float, inertia: float, fastest: float, late: float, period: float,
    answers: Answers,
) -> float:  # fmt: skip
    """The torque [N m] to send to servo `i`, whose readings repeat, in place of the torque `given`: between
    none and this one.

    The encoder may be frozen and the joint free. So what is added to the torque under which the readings
    began to repeat makes a free joint at most as fast as `UNSEEN` says, and a torque above `push` [N m] must
    be answered `late` [s] after a heavy joint, which sticks by as much, would have turned.
    """
    # less torque than before adds nothing
    base = min(max(answers.base[i], min(given, 0.0)), max(given, 0.0))
    change = given - base
    way, asked = (1.0 if change > 0.0 else -1.0), abs(change)
    most = fastest * (UNSEEN * min(asked / push, 1.0) + (MORE if asked > push else 0.0))
    room = max(most - way * answers.pace[i], 0.0) if answers.spent[i] == 0.0 else 0.0
    added = min(asked, room * inertia / period)
    if answers.stood[i] > SLEEPS:
        added = min(added, STRONGEST * push)
    closed = added < 0.01 * asked
    answers.withheld[i] = asked if closed and asked <= push else 0.0
    answers.pace[i] += period * way * added / inertia
    answers.tried[i] = max(answers.tried[i], added)
    gained, heavy = period / (HEAVY * inertia), answers.heavy[i]
    sticks = max(abs(heavy) - gained * push, 0.0)
    answers.heavy[i] = heavy + gained * way * added if added > push else (sticks if heavy > 0.0 else -sticks)
    answers.way[i] += period * answers.heavy[i]
    if abs(answers.way[i]) > NOTICED or (closed and asked > push):
        answers.spent[i] += period
        if answers.spent[i] > late + PATIENCE:
            answers.unanswered[i] = answers.tried[i]
    return base + way * added


@compiled(
    void(
        views(1, int64), record(Measured, *6 * [writes(1)]), record(Limits, *8 * [writes(1)]), views(1),
        views(1), record(Times, *5 * [float64]), boolean, float64, record(Memory, *5 * [writes(1)]),
        record(Answers, *10 * [writes(1)]),
    )
)  # fmt: skip
def limit_torques(
    servos: NDArray[np.intp],
    measured: Measured,
    limits: Limits,
    trust: Array,
    halts: Array,
    times: Times,
    drives: bool,
    push: float,
    memory: Memory,
    answers: Answers,
) -> None:
    """Computes the torques [N m] that are sent now to servos in torque mode, and writes them into
    `memory.given`.

    A torque T and a load d change the speed of a joint of inertia I by (T + d) / I per second. So the torque
    that reaches a speed v when the next torque takes effect is I (v - v_now) / delay - d.

    Args:
        servos: Indices (k,) of these servos.
        measured: Their measurements.
        limits: Their limits.
        trust: Fraction (k,), 0 to 1, of each torque that is permitted: the trust in the measurements.
        halts: What each servo (n_servos,) must do besides: 0 nothing; 1 brake any motion; 2 or -2 go back
            from larger or from smaller angles, where another link is.
        times: When this was measured.
        drives: False if torques may only brake.
        push: Share of a torque limit that may be added to a joint at rest before it moves.
        memory: Commanded torques, and what is kept from one period to the next.
        answers: How readings answered the torques so far.
    """
    elapsed, unseen = times.elapsed, times.age + times.underway
    late = unseen + times.period
    for k in range(len(servos)):
        i = servos[k]
        q, v, wanted = measured.position[i], measured.speed[i], memory.wanted[i]
        if not abs(v) < float("inf"):
            v = wanted = 0.0
        mean = measured.slope[i] if abs(measured.slope[i]) < float("inf") else v
        most, inertia = limits.torque[k], limits.inertia[k]
        fastest = limits.velocity[k]
        if elapsed > 0.0:
            if q != answers.place[i] or v != memory.before[i]:
                answers.stood[i] = answers.pace[i] = answers.heavy[i] = answers.way[i] = 0.0
                answers.spent[i] = answers.tried[i] = answers.unanswered[i] = answers.withheld[i] = 0.0
            else:
                if answers.stood[i] == 0.0:
                    answers.base[i] = measured.between[i] / elapsed
                answers.stood[i] += elapsed
            answers.place[i] = q
            seen = (inertia * (v - memory.before[i]) - measured.between[i]) / elapsed
            seen = min(max(seen, -most), most)
            grows = seen * memory.load[i] >= 0.0 and abs(seen) > abs(memory.load[i])
            opposes = seen * memory.risen[i] <= 0.0
            time = UNLEARN
            if grows and opposes:
                time = LEARN if abs(v) < STANDS * fastest else MOVING
            memory.load[i] += elapsed / (elapsed + time) * (seen - memory.load[i])
            memory.before[i] = v
        load = memory.load[i]
        if abs(mean) > abs(v) + UNSURE * fastest:
            load = memory.load[i] = 0.0
        rise, risen = most * times.period / RISE, memory.risen[i]
        risen = memory.risen[i] = trust[k] * min(max(wanted, risen - rise), risen + rise)
        if not drives:
            risen = 0.0
        inside = limits.lower[k] <= q <= limits.upper[k]
        top = fastest if inside else limits.creep[k]
        settle = 2.0 * limits.approach[k] * SETTLE * late
        given, brake = risen, 0.0
        for way in (-1.0, 1.0):
            left = max(limits.upper[k] - q if way > 0.0 else q - limits.lower[k], 0.0)
            speed, net = way * v, way * load
            # what was sent since the reading has already changed the speed
            soon = speed + (way * measured.since_speed[i] + net * unseen) / inertia
            ahead = max(
                soon,
                way * mean + (way * measured.since_slope[i] + net * (unseen + times.half)) / inertia,
                min(speed, 0.0),
            )
            room = max(left - max(speed, 0.0) * late - settle * late, 0.0)
            safe = 0.0 if halts[i] == 1.0 else min(top, np.sqrt(2.0 * limits.approach[k] * room))
            bound = inertia * (safe - ahead) / late - net
            if halts[i] == 2.0 * way:
                # whatever drives the joint there is held, but nothing is pressed towards the other link
                held = min(max(net, 0.0), HELD * most)
                back = min(inertia * (-BACK - ahead) / late - held, 0.0)
                brake = way * back if back < 0.0 else brake
                continue
            if way * risen > 0.0:
                given = way * max(min(abs(risen) * min(left / FADE, 1.0), bound), 0.0)
            # if angles repeat, or move opposite to the velocity, braking would drive the joint
            if bound < 0.0 < speed and mean != 0.0 and mean * v >= -0.5 * v * v:
                share = min(speed / SLOW, 1.0)
                ends = max(soon + share * (ahead - soon), 0.0)
                least = -(2.0 - share) * inertia * ends / late - share * max(net, 0.0)
                # twice what the links alone need: a motor has inertia too
                brake = way * max(bound - inertia * max(ahead - safe, 0.0) / late, least)
        if answers.stood[i] > 0.0 and drives and halts[i] == 0.0:
            given = add_with_care(i, given, push * most, inertia, fastest, late, times.period, answers)
        if brake != 0.0:
            given = trust[k] * min(max(brake, -most), most)
        memory.given[i] = min(max(given, -most), most)
