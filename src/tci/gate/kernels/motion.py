"""Checks in one compiled loop that servos follow their references, for `tci.gate.joint_monitor`."""

from __future__ import annotations

from numba import boolean, float64, int64

from tci.compiled import compiled, inlined, reads, returns, views, writes
from tci.frames import Array

FOLLOWS, LATE, OPPOSED, FROZEN, DISAGREES, DEAF, JUMPED = range(7)
"""Results: no fault; a servo far from its reference, moving against it, or frozen; an angle that contradicts
its velocity; an angle that stays constant although the torque changes; an angle that jumps."""
FOLLOWING_ERROR, LAG, PATIENCE, OPPOSING, LEAST_SPEED, LONGEST_REPEAT, TRAVEL, FORGETS, PUSH, STEP = range(10)
"""Indices of the settings."""
ANGLE, SPEED, ANGLE_BEFORE, SPEED_BEFORE = range(4)
"""Rows of two successive readings (4, n_servos): angles [rad] and velocities [rad/s] now, and before."""
FOLLOWED, LOOSE = range(2)
"""Rows of the kinds of modes (2, k): those judged by a reference, and torque mode."""
LATE_SINCE, OPPOSED_SINCE, REPEATS_SINCE, ORIGIN = range(4)
"""Rows of the memory (4, n_servos): time [s] since which a condition has held without interruption, or
infinity; the reference [rad] when the angle began to repeat."""
DRIFT, WEAKEST, STRONGEST, PUSHED_SINCE = range(4)
"""Rows of the memory of velocities (4, n_servos): deviation [rad] of the integrated velocity from the angle;
least and largest torque [N m] since both repeat, and time [s] since which these differ."""
TORQUE_LIMIT, ACCELERATION, FASTEST = range(3)
"""Rows of the joints' limits (3, n_servos): torque [N m], acceleration [rad/s2], speed [rad/s]."""
SELDOM = 0.025
"""Longest time [s] between readings over which velocities are integrated. Assumed: in a longer time a
velocity may change unnoticed."""
MONITOR = returns(reads(2), reads(1), writes(2), writes(2), writes(2), writes(1))
"""Type of a monitor's data: limits and settings; readings, memory, memory of velocities; worst."""


@compiled(boolean(views(1)))
def all_finite(values: Array) -> bool:
    """Returns True if no value (n,) is infinite or NaN."""
    sum_of_zeros = 0.0
    for i in range(len(values)):
        sum_of_zeros += 0.0 * values[i]
    return bool(sum_of_zeros == 0.0)


@inlined
def _jump(readings: Array, limits: Array, step: float, elapsed: float, worst: Array) -> bool:
    """Returns True if an angle changed by more than its speed limit allows plus a `step` [rad].

    Writes the index of the worst servo and its change [rad] into `worst` (2,).
    """
    most = 0.0
    for i in range(readings.shape[1]):
        change = abs(readings[ANGLE, i] - readings[ANGLE_BEFORE, i])
        beyond = change - (limits[FASTEST, i] * elapsed + step)
        if beyond > most:
            most, worst[0], worst[1] = beyond, i, change
    return most > 0.0


@inlined
def judge_motion(
    servos: Array,
    kinds: Array,
    readings: Array,
    position: Array,
    velocity: Array,
    settings: Array,
    now: float,
    elapsed: float,
    memory: Array,
    worst: Array,
) -> int:
    """Returns the fault in the motion of `servos` (k,) whose mode follows a reference.

    The readings are `elapsed` [s] apart; `position` [rad] and `velocity` [rad/s] (k,) are their reference.
    Updates the memory, and writes into `worst` (2,) the index of the worst servo, and its error or its
    reference's motion [rad].
    """
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
    """Returns the fault in the angles of `servos` (k,), found by comparison with velocities and torques.

    The readings are `elapsed` [s] apart; a velocity that is NaN is ignored. Angles that follow a reference
    are not judged by velocities. `torque` (k,) [N m] was sent to those in torque mode. Updates the memory,
    and writes into `worst` (2,) the index of the worst servo and the motion [rad] that its angle does not
    show.
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
        MONITOR, views(1, int64), views(2, boolean), views(1), views(1), views(1), views(1), views(1),
        float64, float64,
    )
)  # fmt: skip
def judge_reading(
    monitor: tuple[Array, ...], servos: Array, kinds: Array, position: Array, velocity: Array, torque: Array,
    angles: Array, speeds: Array, now: float, elapsed: float,
) -> int:  # fmt: skip
    """Judges a reading of all `angles` [rad] and `speeds` [rad/s] (n_servos,), made at time `now` [s].

    Returns the first fault found by `_jump`, `judge_velocity` and `judge_motion`. A reading that is not
    `elapsed` [s] after the one before is only stored. `servos` (k,) have the references `position` [rad],
    `velocity` [rad/s] and `torque` [N m] (k,).
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
    return judge_motion(servos, kinds, readings, position, velocity, settings, now, elapsed, memory, worst)
