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
    phase: Array
    """What the present push does: PUSHES, COASTS, BRAKES or RESTS."""
    spent: Array
    """Times [s] since the push coasts or rests."""
    pace: Array
    """Speeds [rad/s] that the push would have given a heavy free joint."""
    way: Array
    """Ways [rad] that it would have gone."""
    size: Array
    """Sizes [N m] of the push before."""
    pushes: Array
    """Numbers of pushes in a row that no reading answered."""


PUSHES, COASTS, BRAKES, RESTS = range(4)
SLEEPS = 0.06
"""Time [s] for which a reading repeats exactly until its joint is pushed with care, since the encoder may be
frozen. With 0.15 s an iCub's shoulder without friction turned by 53 degrees instead of 19."""
HEAVY = 4.0
"""Inertia, as a multiple of the links' least, up to which a free joint must answer a push: with its motor."""
NOTICED = float(np.deg2rad(0.15))
"""Way [rad] of such a joint after which a push ends. It coasts three times as far until a reading tells it:
more than a count of a coarse encoder."""
BRAKED = 0.9
"""Share of a push that nothing answered that is taken back. If the joint turned unseen, friction does the
rest; it must not turn back."""
HARDER = 1.5
"""Ratio between a push and the one before, while nothing answers."""
ENOUGH = 3.0
"""Pushes without an answer after which only a harder command is tried."""
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
def push_with_care(
    i: int, given: float, inertia: float, first: float, late: float, period: float, answers: Answers
) -> float:
    """Returns the torque [N m] to send to servo `i`, whose readings repeat, in place of the torque `given`.

    The encoder may be frozen and the joint free. So the torque goes above that under which the readings began
    to repeat only in pushes. A push ends when a heavy free joint would have turned far enough to be noticed.
    If no reading has answered it when it must have arrived, most of its momentum is taken back, whatever the
    inertia, and the next push may be harder. `first` [N m] is the largest first push, and `late` [s] the time
    until a reading can answer.
    """
    # less torque than before is no push
    base = min(max(answers.base[i], min(given, 0.0)), max(given, 0.0))
    change, size, phase = given - base, answers.size[i], answers.phase[i]
    if phase == PUSHES:
        if answers.pushes[i] >= ENOUGH and abs(change) < HARDER * size:
            return base
        most = max(first, HARDER * size)
        change = min(max(change, -most), most)
        answers.pace[i] += period * change / (HEAVY * inertia)
        answers.way[i] += period * answers.pace[i]
        if abs(answers.way[i]) > NOTICED:
            answers.phase[i], answers.spent[i], answers.size[i] = COASTS, 0.0, abs(change)
            answers.pace[i] *= BRAKED
        return base + change
    answers.spent[i] += period
    if phase == COASTS and answers.spent[i] > late:
        answers.phase[i] = BRAKES
    elif phase == BRAKES:
        before = answers.pace[i]
        least = min(size, HEAVY * inertia * abs(before) / period)
        back = -least if before > 0.0 else least
        answers.pace[i] += period * back / (HEAVY * inertia)
        if abs(answers.pace[i]) < 1e-9:
            answers.phase[i], answers.spent[i] = RESTS, 0.0
        return base + back
    elif phase == RESTS and answers.spent[i] > late:
        answers.phase[i], answers.pace[i], answers.way[i] = PUSHES, 0.0, 0.0
        answers.pushes[i] += 1.0
    return base


@compiled(
    void(
        views(1, int64), record(Measured, *6 * [writes(1)]), record(Limits, *8 * [writes(1)]), views(1),
        views(1), record(Times, *5 * [float64]), boolean, record(Memory, *5 * [writes(1)]),
        record(Answers, *9 * [writes(1)]),
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
                answers.stood[i] = answers.phase[i] = answers.pace[i] = answers.way[i] = 0.0
                answers.size[i] = answers.pushes[i] = 0.0
            else:
                if answers.stood[i] == 0.0:
                    answers.base[i] = measured.between[i] / elapsed
                answers.stood[i] += elapsed
            answers.place[i] = q
        careful = answers.stood[i] > SLEEPS
        if elapsed > 0.0 and not careful:
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
                if careful and answers.size[i] > 0.0:
                    bound = max(bound, way * answers.base[i] + HARDER * answers.size[i])
                given = way * max(min(abs(risen) * min(left / FADE, 1.0), bound), 0.0)
            # if angles repeat, or move opposite to the velocity, braking would drive the joint
            if bound < 0.0 < speed and mean != 0.0 and mean * v >= -0.5 * v * v:
                share = min(speed / SLOW, 1.0)
                ends = max(soon + share * (ahead - soon), 0.0)
                least = -(2.0 - share) * inertia * ends / late - share * max(net, 0.0)
                # twice what the links alone need: a motor has inertia too
                brake = way * max(bound - inertia * max(ahead - safe, 0.0) / late, least)
        if careful and drives and halts[i] == 0.0:
            given = push_with_care(i, given, inertia, inertia * fastest / late, late, times.period, answers)
        if brake != 0.0:
            given = trust[k] * min(max(brake, -most), most)
        memory.given[i] = min(max(given, -most), most)
