"""Checks in one compiled loop that servos follow their references. `tci.gate.joint_monitor` calls this
loop."""

from __future__ import annotations

from numba import boolean, float64, int64

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, returns, views, writes

FOLLOWS, LATE, OPPOSED, FROZEN, DISAGREES, DEAF, JUMPED = range(7)
"""Possible results of the check of a joint reading, in this order:

- no fault
- a servo is far from its reference
- a servo moves against its reference
- an angle stays constant while the reference moves
- an angle contradicts the measured velocity
- an angle stays constant although the torque changes
- an angle jumps
"""
FOLLOWING_ERROR, LAG, PATIENCE, OPPOSING, LEAST_SPEED, LONGEST_REPEAT, TRAVEL, FORGETS, PUSH, STEP = range(10)
"""Indices into the array `settings` (10,), which contains the values of `MonitorSettings` as numbers."""
ANGLE, SPEED, ANGLE_BEFORE, SPEED_BEFORE = range(4)
"""Rows of two successive readings (4, n_servos): angles [rad] and velocities [rad/s] of this reading, then of
the reading before."""
FOLLOWED, LOOSE = range(2)
"""Rows of a table (2, k) of truth values, computed from the control modes of k servos. `FOLLOWED`: True for a
servo whose angle must follow a reference. `LOOSE`: True for a servo in torque mode."""
LATE_SINCE, OPPOSED_SINCE, REPEATS_SINCE, ORIGIN = range(4)
"""Rows of an array (4, n_servos) that the check of motions keeps from one reading to the next. The first
three rows contain the time [s] at which a servo began to be far from its reference, to move against it, or to
repeat its angle; infinity if the servo does not do so now. The last row is the reference [rad] at the time
when the angle began to repeat.
"""
DRIFT, WEAKEST, STRONGEST, PUSHED_SINCE = range(4)
"""Rows of an array (4, n_servos) that the comparison of angles with velocities and torques keeps from one
reading to the next:

- difference [rad] between the recent motion according to the measured velocity and according to the angle
- least torque [N m] that was sent in torque mode since the measured angle and velocity stopped changing
- largest torque [N m] in the same time
- time [s] at which the difference of these two torques became large enough to move the joint; infinity while
  the difference is smaller
"""
TORQUE_LIMIT, ACCELERATION, FASTEST = range(3)
"""Rows of the limits (3, n_servos) of the joints: torque [N m], acceleration [rad/s2] and speed [rad/s]."""
SELDOM = 0.025
"""Longest time [s] between two readings for which angles are compared with velocities. Assumed: in a longer
time a velocity may change without being measured."""
MONITOR = returns(reads(2), reads(1), writes(2), writes(2), writes(2), writes(1))
"""Numba types of the arrays of a monitor: limits (3, n_servos), settings (10,), readings (4, n_servos), two
memories (4, n_servos) of motions and of velocities, and the worst servo (2,) with the size [rad] of its
fault."""


@compiled(boolean(views(1)))
def all_finite(values: Array) -> bool:
    """Returns True if no value (n,) is infinite or NaN."""
    sum_of_zeros = 0.0
    for i in range(len(values)):
        sum_of_zeros += 0.0 * values[i]
    return bool(sum_of_zeros == 0.0)


@inlined
def _jump(readings: Array, limits: Array, step: float, elapsed: float, worst: Array) -> bool:
    """Returns True if the angle of any servo changed by more than its speed limit allows in `elapsed` [s],
    plus `step` [rad].

    Writes into `worst` (2,) the index of the servo with the largest excess, and the change [rad] of its
    angle.
    """
    most = 0.0
    for i in range(readings.shape[1]):
        change = abs(readings[ANGLE, i] - readings[ANGLE_BEFORE, i])
        beyond = change - (limits[FASTEST, i] * elapsed + step)
        mean = 0.5 * (readings[SPEED, i] + readings[SPEED_BEFORE, i])
        if abs(readings[ANGLE, i] - readings[ANGLE_BEFORE, i] - mean * elapsed) <= step:
            continue  # a blow, or a joint that really is too fast: angle and velocity agree
        if beyond > most:
            most, worst[0], worst[1] = beyond, i, change
    return most > 0.0


@inlined
def judge_motion(
    servos: Array,
    kinds: Array,
    readings: Array,
    sent: Array,
    settings: Array,
    now: float,
    elapsed: float,
    memory: Array,
    worst: Array,
) -> int:
    """Checks that servos follow their references. Returns FOLLOWS, or the fault: LATE (too far from the
    reference), OPPOSED (moves against the reference) or FROZEN (the angle stays constant while the reference
    moves).

    The rows of `sent` (3, k) are the references [rad] of `servos` (k,), their velocities [rad/s] and the
    references a lag ago [rad]; `kinds` shows which servos must follow them. `readings` (4, n_servos) are
    angles [rad] and velocities [rad/s] at `now` [s], then those `elapsed` [s] earlier. `memory` (4, n_servos)
    is kept from call to call. In case of a fault, writes into `worst` (2,) the index of the servo in `servos`
    and, except for OPPOSED, an angle [rad]: the distance from the reference (LATE) or the motion of the
    reference (FROZEN).
    """
    position, velocity, lagging = sent[0], sent[1], sent[2]
    longest = -1.0
    for k in range(len(servos)):
        servo = servos[k]
        error = abs(position[k] - readings[ANGLE, servo])
        far = error > settings[FOLLOWING_ERROR] + settings[LAG] * abs(velocity[k])
        begin = min(memory[LATE_SINCE, servo], now) if kinds[FOLLOWED, k] and far else float("inf")
        memory[LATE_SINCE, servo] = begin
        if now - begin > max(longest, settings[PATIENCE]):
            longest, worst[0], worst[1] = now - begin, k, error
    if longest >= 0.0:
        return LATE
    for k in range(len(servos)):
        servo = servos[k]
        speed = (readings[ANGLE, servo] - readings[ANGLE_BEFORE, servo]) / elapsed
        against = velocity[k] * speed < 0.0 and min(abs(speed), abs(velocity[k])) > settings[LEAST_SPEED]
        begin = min(memory[OPPOSED_SINCE, servo], now) if kinds[FOLLOWED, k] and against else float("inf")
        memory[OPPOSED_SINCE, servo] = begin
        if now - begin > max(longest, settings[OPPOSING]):
            longest, worst[0] = now - begin, k
    if longest >= 0.0:
        return OPPOSED
    found = FOLLOWS
    for k in range(len(servos)):
        servo = servos[k]
        repeats = kinds[FOLLOWED, k] and readings[ANGLE, servo] == readings[ANGLE_BEFORE, servo]
        begin = min(memory[REPEATS_SINCE, servo], now) if repeats else float("inf")
        memory[REPEATS_SINCE, servo] = begin
        if not begin < now:
            memory[ORIGIN, servo] = position[k]
        way = abs(position[k] - memory[ORIGIN, servo])
        # at the start of a motion a healthy joint stands too, until it has to follow even with its lag
        way = min(way, abs(lagging[k] - readings[ANGLE, servo]))
        if found == FOLLOWS and now - begin > settings[LONGEST_REPEAT] and way > settings[TRAVEL]:
            found, worst[0], worst[1] = FROZEN, k, way
    return found


@inlined
def judge_velocity(
    servos: Array,
    kinds: Array,
    readings: Array,
    torque: Array,
    limits: Array,
    settings: Array,
    now: float,
    elapsed: float,
    memory: Array,
    worst: Array,
) -> int:
    """Compares measured angles with velocities and torques, for servos that need not follow a reference.
    Returns FOLLOWS, or the fault: DISAGREES (an angle contradicts the velocity) or DEAF (an angle stays
    constant although the torque changes).

    `torque` (k,) [N m] was sent to those of the `servos` (k,) that are in torque mode (row LOOSE of `kinds`).
    `readings` (4, n_servos) are angles [rad] and velocities [rad/s] at `now` [s], then those `elapsed` [s]
    earlier; a velocity that is NaN is ignored. `memory` (4, n_servos) is kept from call to call. Writes into
    `worst` (2,) the index in `servos` of the worst servo, and the difference [rad] of its measured motion
    from the expected motion.
    """
    keeps = max(1.0 - elapsed / settings[FORGETS], 0.0)
    found, worst[1] = FOLLOWS, 0.0
    for k in range(len(servos)):
        servo = servos[k]
        speed, change = readings[SPEED, servo], readings[ANGLE, servo] - readings[ANGLE_BEFORE, servo]
        drift = 0.0
        mean = 0.5 * (speed + readings[SPEED_BEFORE, servo])
        if not kinds[FOLLOWED, k] and abs(mean) < float("inf") and elapsed <= SELDOM:
            drift = keeps * memory[DRIFT, servo]
            # In torque mode only the velocity brakes a joint, so one that is too small counts too.
            way = max(abs(speed) * elapsed, abs(change) if kinds[LOOSE, k] else 0.0)
            if way > settings[LEAST_SPEED] * elapsed:
                drift += mean * elapsed - change
        memory[DRIFT, servo] = drift
        allowed = settings[FOLLOWING_ERROR] + settings[LAG] * abs(speed)
        if abs(drift) > max(allowed, worst[1]):
            found, worst[0], worst[1] = DISAGREES, k, abs(drift)
    if found != FOLLOWS:
        return found
    for k in range(len(servos)):
        servo = servos[k]
        repeats = (
            readings[ANGLE, servo] == readings[ANGLE_BEFORE, servo]
            and readings[SPEED, servo] == readings[SPEED_BEFORE, servo]
        )
        if not (kinds[LOOSE, k] and repeats):
            memory[WEAKEST, servo] = memory[PUSHED_SINCE, servo] = float("inf")
            memory[STRONGEST, servo] = -float("inf")
            continue
        memory[WEAKEST, servo] = min(memory[WEAKEST, servo], torque[k])
        memory[STRONGEST, servo] = max(memory[STRONGEST, servo], torque[k])
        push = (memory[STRONGEST, servo] - memory[WEAKEST, servo]) / limits[TORQUE_LIMIT, servo]
        begin = min(memory[PUSHED_SINCE, servo], now) if push > settings[PUSH] else float("inf")
        memory[PUSHED_SINCE, servo] = begin
        way = 0.5 * push * limits[ACCELERATION, servo] * (now - begin) ** 2
        if begin < now and way > max(settings[TRAVEL], worst[1]):
            found, worst[0], worst[1] = DEAF, k, way
    return found


@compiled(
    int64(
        MONITOR, views(1, int64), views(2, boolean), views(2), views(1), views(1), views(1), float64, float64,
    )
)  # fmt: skip
def judge_reading(
    monitor: tuple[Array, ...], servos: Array, kinds: Array, sent: Array, torque: Array, angles: Array,
    speeds: Array, now: float, elapsed: float,
) -> int:  # fmt: skip
    """Checks a joint reading for faults: `angles` [rad] and `speeds` [rad/s] (n_servos,) of all servos,
    measured at the time `now` [s].

    Returns the fault as one of the numbers LATE to JUMPED; FOLLOWS if there is no fault. `elapsed` [s] is the
    time since the previous reading. If `elapsed` is 0 or less, the reading is only stored. `sent` is
    explained at `judge_motion`, and `torque` (k,) [N m] was sent to the `servos` (k,). `kinds`
    (2, k) has the rows FOLLOWED and LOOSE; `monitor` contains the arrays listed at `MONITOR`.
    """
    limits, settings, readings, memory, drifts, worst = monitor
    for i in range(len(angles)):
        readings[ANGLE_BEFORE, i], readings[SPEED_BEFORE, i] = readings[ANGLE, i], readings[SPEED, i]
        readings[ANGLE, i], readings[SPEED, i] = angles[i], speeds[i]
    if not elapsed > 0.0:
        return FOLLOWS
    if _jump(readings, limits, settings[STEP], elapsed, worst):
        return JUMPED
    found = judge_velocity(servos, kinds, readings, torque, limits, settings, now, elapsed, drifts, worst)
    if found != FOLLOWS:
        return found
    return judge_motion(servos, kinds, readings, sent, settings, now, elapsed, memory, worst)
