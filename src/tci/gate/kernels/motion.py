"""Checks in one compiled loop that servos follow their references. `tci.gate.joint_monitor` calls this
loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, record, views, writes

FOLLOWS, LATE, OPPOSED, FROZEN, DISAGREES, DEAF, JUMPED = range(7)
"""Possible results of the check of a joint reading, in this order:

- no fault
- a servo is far from its reference
- a servo moves against its reference
- an angle stays constant while the reference moves
- an angle contradicts the measured velocity
- angle and velocity stay constant whatever the torque
- an angle jumps
"""
SELDOM = 0.025
"""Longest time [s] between two readings for which angles are compared with velocities. Assumed: in a longer
time a velocity may change without being measured."""
STRUCK = 4.0
"""Multiple of its speed limit beyond which no blow drives a joint. Assumed: wrists were struck to three times
theirs. Without it, a velocity that a robot derives from its encoder would explain any jump after a lost
reading."""


class Settings(NamedTuple):
    """The values of `MonitorSettings`, which explains them."""

    following_error: float
    """Angle [rad]."""
    lag: float
    """Time [s]."""
    patience: float
    """Time [s]."""
    opposing: float
    """Time [s]."""
    least_speed: float
    """Speed [rad/s]."""
    frozen: float
    """Time [s]."""
    frozen_travel: float
    """Angle [rad]."""
    drift: float
    """Time constant [s]."""
    push: float
    """Fraction of the torque limit."""
    encoder_step: float
    """Angle [rad]."""


class Limits(NamedTuple):
    """Limits of all servos, each (n_servos,)."""

    torque: Array
    """Largest torques [N m]."""
    velocity: Array
    """Largest speeds [rad/s]."""


class Readings(NamedTuple):
    """Two successive readings of all servos, each (n_servos,)."""

    angle: Array
    """Angles [rad] of this reading."""
    speed: Array
    """Velocities [rad/s] of this reading."""
    angle_before: Array
    """Angles [rad] of the reading before."""
    speed_before: Array
    """Velocities [rad/s] of the reading before."""


class Kinds(NamedTuple):
    """How k servos are commanded, each (k,)."""

    follows: NDArray[np.bool_]
    """True for a servo whose angle must follow a reference."""
    loose: NDArray[np.bool_]
    """True for a servo in torque mode."""


class Sent(NamedTuple):
    """References of k servos, each (k,)."""

    position: Array
    """Angles [rad]."""
    velocity: Array
    """Velocities [rad/s]."""


class Motions(NamedTuple):
    """What the check of motions keeps of all servos from one reading to the next, each (n_servos,)."""

    late_since: Array
    """Times [s] at which servos began to be far from their references; infinity for others."""
    opposed_since: Array
    """Times [s] at which servos began to move against their references; infinity for others."""
    rose: Array
    """Times [s] at which the references went towards larger angles last; -infinity if they never did."""
    fell: Array
    """The same towards smaller angles."""
    repeats_since: Array
    """Times [s] at which servos began to repeat their angles; infinity for others."""
    left_since: Array
    """Times [s] since which the references are far from `origin`; infinity for others."""
    origin: Array
    """References [rad] at the times when the angles began to repeat."""


class Been(NamedTuple):
    """Where servos that nobody commands were of late, each (n_servos,); for those under command, the reading
    before."""

    low: Array
    """Smallest angles [rad]."""
    high: Array
    """Largest angles [rad]."""


class Drifts(NamedTuple):
    """What the comparison of angles with velocities keeps of all servos from one reading to the next, each
    (n_servos,)."""

    drift: Array
    """Differences [rad] between the recent motion according to the measured velocity and to the angle."""


class Monitor(NamedTuple):
    """What a monitor knows of all servos."""

    limits: Limits
    settings: Settings
    readings: Readings
    been: Been
    motions: Motions
    drifts: Drifts
    worst: Array
    """The worst servo and the size [rad] of its fault (2,)."""


MONITOR = record(
    Monitor,
    record(Limits, *2 * [writes(1)]),
    record(Settings, *10 * [float64]),
    record(Readings, *4 * [writes(1)]),
    record(Been, *2 * [writes(1)]),
    record(Motions, *7 * [writes(1)]),
    record(Drifts, *1 * [writes(1)]),
    writes(1),
)
"""Numba's type of a `Monitor`."""


@compiled(boolean(views(1)))
def all_finite(values: Array) -> bool:
    """Returns True if no value (n,) is infinite or NaN."""
    sum_of_zeros = 0.0
    for i in range(len(values)):
        sum_of_zeros += 0.0 * values[i]
    return bool(sum_of_zeros == 0.0)


@inlined
def _note_where(been: Been, servos: Array, readings: Readings, creep: float, elapsed: float) -> None:
    """Notes where joints were before the latest reading, and forgets what was earlier as fast as they `creep`
    [rad/s]. The `servos` (k,) are under command."""
    for i in range(len(readings.angle)):
        before = readings.angle_before[i]
        been.low[i] = min(before, been.low[i] + creep * elapsed)
        been.high[i] = max(before, been.high[i] - creep * elapsed)
    for k in range(len(servos)):
        been.low[servos[k]] = been.high[servos[k]] = readings.angle_before[servos[k]]


@inlined
def _jump(readings: Readings, been: Been, limits: Limits, step: float, elapsed: float, worst: Array) -> bool:
    """Returns True if the angle of any servo changed by more than its speed limit allows in `elapsed` [s],
    plus `step` [rad]. A joint that somebody bent springs back faster, but not elsewhere than it was.

    Writes into `worst` (2,) the index of the servo with the largest excess, and the change [rad] of its
    angle.
    """
    most = 0.0
    for i in range(len(readings.angle)):
        change = abs(readings.angle[i] - min(max(readings.angle[i], been.low[i]), been.high[i]))
        beyond = change - (limits.velocity[i] * elapsed + step)
        mean = 0.5 * (readings.speed[i] + readings.speed_before[i])
        agrees = step
        if elapsed > SELDOM and change <= STRUCK * limits.velocity[i] * elapsed + step:
            # after a lost reading nobody knows when the velocity changed from the one to the other
            agrees += 0.5 * abs(readings.speed[i] - readings.speed_before[i]) * elapsed
        if abs(readings.angle[i] - readings.angle_before[i] - mean * elapsed) <= agrees:
            continue  # a blow, or a joint that really is too fast: angle and velocity agree
        if beyond > most:
            most, worst[0], worst[1] = beyond, i, change
    return most > 0.0


@inlined
def judge_motion(
    servos: Array,
    kinds: Kinds,
    readings: Readings,
    sent: Sent,
    lags: Array,
    settings: Settings,
    now: float,
    elapsed: float,
    memory: Motions,
    worst: Array,
) -> int:
    """Checks that servos follow their references. Returns FOLLOWS, or the fault: LATE (too far from the
    reference), OPPOSED (moves against the reference) or FROZEN (the angle stays constant while the reference
    moves).

    `sent` are the references of `servos` (k,). The `readings` are of `now` [s] and of `elapsed` [s] earlier.
    A joint that goes where its reference went within its own of the `lags` (n_servos,) [s] only lags.
    In case of a fault, writes into `worst` (2,) the index of the servo in `servos` and, except for OPPOSED,
    an angle [rad]: the distance from the reference (LATE) or the motion of the reference (FROZEN).
    """
    position, velocity = sent.position, sent.velocity
    longest = -1.0
    for k in range(len(servos)):
        servo = servos[k]
        error = abs(position[k] - readings.angle[servo])
        far = error > settings.following_error + settings.lag * abs(velocity[k])
        begin = min(memory.late_since[servo], now) if kinds.follows[k] and far else float("inf")
        memory.late_since[servo] = begin
        if now - begin > max(longest, settings.patience):
            longest, worst[0], worst[1] = now - begin, k, error
    if longest >= 0.0:
        return LATE
    for k in range(len(servos)):
        servo = servos[k]
        speed = (readings.angle[servo] - readings.angle_before[servo]) / elapsed
        if velocity[k] > settings.least_speed:
            memory.rose[servo] = now
        elif velocity[k] < -settings.least_speed:
            memory.fell[servo] = now
        went = memory.rose[servo] if speed > 0.0 else memory.fell[servo]
        against = velocity[k] * speed < 0.0 and min(abs(speed), abs(velocity[k])) > settings.least_speed
        against = against and now - elapsed - went > lags[servo]
        begin = min(memory.opposed_since[servo], now) if kinds.follows[k] and against else float("inf")
        memory.opposed_since[servo] = begin
        if now - begin > max(longest, settings.opposing):
            longest, worst[0] = now - begin, k
    if longest >= 0.0:
        return OPPOSED
    found = FOLLOWS
    for k in range(len(servos)):
        servo = servos[k]
        repeats = kinds.follows[k] and readings.angle[servo] == readings.angle_before[servo]
        begin = min(memory.repeats_since[servo], now) if repeats else float("inf")
        memory.repeats_since[servo] = begin
        if not begin < now:
            memory.origin[servo] = position[k]
        way = abs(position[k] - memory.origin[servo])
        # at the start of a motion a healthy joint stands too, until it has to follow even with its lag
        left = repeats and way > 0.5 * settings.frozen_travel
        begin = memory.left_since[servo] = min(memory.left_since[servo], now) if left else float("inf")
        if found == FOLLOWS and now - begin > settings.frozen and way > settings.frozen_travel:
            found, worst[0], worst[1] = FROZEN, k, way
    return found


@inlined
def judge_velocity(
    servos: Array,
    kinds: Kinds,
    readings: Readings,
    unanswered: Array,
    limits: Limits,
    settings: Settings,
    elapsed: float,
    memory: Drifts,
    worst: Array,
) -> int:
    """Compares measured angles with velocities and torques, for servos that need not follow a reference.
    Returns FOLLOWS, or the fault: DISAGREES (an angle contradicts the velocity) or DEAF (no reading answers
    the torque).

    `unanswered` (k,) [N m] are torques that no reading answered. The second of the `readings` is
    `elapsed` [s] older; a velocity that is NaN is ignored. Writes into `worst` (2,) the index in `servos` of
    the worst servo, and the difference [rad] of its measured motion from the expected motion, or the share of
    its torque limit.
    """
    keeps = max(1.0 - elapsed / settings.drift, 0.0)
    found, worst[1] = FOLLOWS, 0.0
    for k in range(len(servos)):
        servo = servos[k]
        speed, change = readings.speed[servo], readings.angle[servo] - readings.angle_before[servo]
        drift = 0.0
        mean = 0.5 * (speed + readings.speed_before[servo])
        if not kinds.follows[k] and abs(mean) < float("inf") and elapsed <= SELDOM:
            drift = keeps * memory.drift[servo]
            # In torque mode only the velocity brakes a joint, so one that is too small counts too.
            way = max(abs(speed) * elapsed, abs(change) if kinds.loose[k] else 0.0)
            if way > settings.least_speed * elapsed:
                drift += mean * elapsed - change
        memory.drift[servo] = drift
        allowed = settings.following_error + settings.lag * abs(speed)
        if abs(drift) > max(allowed, worst[1]):
            found, worst[0], worst[1] = DISAGREES, k, abs(drift)
    if found != FOLLOWS:
        return found
    for k in range(len(servos)):
        share = unanswered[k] / limits.torque[servos[k]]
        if kinds.loose[k] and share > max(settings.push, worst[1]):
            found, worst[0], worst[1] = DEAF, k, share
    return found


@compiled(
    int64(
        MONITOR, views(1, int64), record(Kinds, *2 * [writes(1, boolean)]), record(Sent, *2 * [writes(1)]),
        views(1), views(1), views(1), views(1), float64, float64,
    )
)  # fmt: skip
def judge_reading(
    monitor: Monitor, servos: Array, kinds: Kinds, sent: Sent, unanswered: Array, lags: Array,
    angles: Array, speeds: Array, now: float, elapsed: float,
) -> int:  # fmt: skip
    """Checks a joint reading for faults: `angles` [rad] and `speeds` [rad/s] (n_servos,) of all servos,
    measured at the time `now` [s].

    Returns the fault as one of the numbers LATE to JUMPED; FOLLOWS if there is no fault. `elapsed` [s] is the
    time since the previous reading. If `elapsed` is 0 or less, the reading is only stored. `sent` was
    sent to the `servos` (k,), and `unanswered` (k,) [N m] are torques that no reading answered. Joints lag by
    `lags` (n_servos,) [s] at most.
    """
    limits, settings, readings, worst = monitor.limits, monitor.settings, monitor.readings, monitor.worst
    for i in range(len(angles)):
        readings.angle_before[i], readings.speed_before[i] = readings.angle[i], readings.speed[i]
        readings.angle[i], readings.speed[i] = angles[i], speeds[i]
    if not elapsed > 0.0:
        return FOLLOWS
    _note_where(monitor.been, servos, readings, settings.least_speed, elapsed)
    if _jump(readings, monitor.been, limits, settings.encoder_step, elapsed, worst):
        return JUMPED
    found = judge_velocity(
        servos, kinds, readings, unanswered, limits, settings, elapsed, monitor.drifts, worst
    )
    if found != FOLLOWS:
        return found
    return judge_motion(servos, kinds, readings, sent, lags, settings, now, elapsed, monitor.motions, worst)
