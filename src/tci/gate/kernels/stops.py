"""Compiled loops that plan, check and evaluate the jerk-limited stops of servos."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.gate.kernels.couplings import box_keeps
from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, record, returns, views, writes


class Limits(NamedTuple):
    """Limits of n servos, each (n,)."""

    lower: Array
    """Least angles [rad]."""
    upper: Array
    """Largest angles [rad]."""
    acceleration: Array
    """Largest accelerations [rad/s2]."""
    jerk: Array
    """Largest jerks [rad/s3]."""


class Stop(NamedTuple):
    """A planned stop of n servos, each (n,) if no shape is given."""

    span: Array
    """Least and largest angles (2, n) [rad] during the stop."""
    here: Array
    """Angles [rad] one period before the stop."""
    end: Array
    """Angles [rad] at its end."""
    angle: Array
    """Angles [rad] at its start."""
    speed: Array
    """Velocities [rad/s] at its start."""
    pull: Array
    """Accelerations [rad/s2] at its start."""
    first_jerk: Array
    """Jerks [rad/s3] while the braking acceleration builds up."""
    last_jerk: Array
    """Jerks [rad/s3] while the braking acceleration returns to zero."""
    ramp: Array
    """Durations [s] for which the braking acceleration builds up."""
    plateau: Array
    """Durations [s] for which it stays constant."""
    release: Array
    """Durations [s] for which it returns to zero."""


STOP = record(Stop, writes(2), *10 * [writes(1)])
"""Numba's type of a `Stop`."""


def empty_stop(count: int) -> Stop:
    """A `Stop` of `count` servos, to be written by `plan_stop`."""
    return Stop(np.zeros((2, count)), *np.zeros((10, count)))


@inlined
def _plan(stop: Stop, i: int, most: float, jerk: float) -> None:
    """Plans the fastest stop of servo `i` with accelerations up to `most` [rad/s2] and the `jerk` [rad/s3],
    and writes its jerks and durations into `stop`, which already contains the state from which the servo
    stops."""
    v, a = stop.speed[i], stop.pull[i]
    final = v + a * abs(a) / (2.0 * jerk)  # velocity if the acceleration were released at once
    peak = a
    if final > 0.0:
        peak = -min(np.sqrt(jerk * v + a * a / 2.0), most)
    elif final < 0.0:
        peak = min(np.sqrt(a * a / 2.0 - jerk * v), most)
    ramp, release = abs(peak - a) / jerk, abs(peak) / jerk
    gained = (a + peak) / 2.0 * ramp + peak / 2.0 * release
    plateau = 0.0 if peak == 0.0 else max(-(v + gained) / peak, 0.0)
    stop.first_jerk[i] = jerk if peak > a else -jerk
    stop.last_jerk[i] = jerk if peak < 0.0 else -jerk
    stop.ramp[i], stop.release[i] = ramp, release
    # Without a plateau the remaining velocity is rounding.
    stop.plateau[i] = plateau if abs(peak) >= most else 0.0


@inlined
def _follow(stop: Stop, i: int, time: float) -> tuple[float, float, float]:
    """Returns angle [rad], velocity [rad/s] and acceleration [rad/s2] of servo `i` at `time` [s] after it
    began its planned `stop`."""
    q, v, a = stop.angle[i], stop.speed[i], stop.pull[i]
    for jerk, lasts in (
        (stop.first_jerk[i], stop.ramp[i]),
        (0.0, stop.plateau[i]),
        (stop.last_jerk[i], stop.release[i]),
    ):
        t = min(time, lasts)
        q += t * (v + t * (a / 2.0 + t * jerk / 6.0))
        v += t * (a + t * jerk / 2.0)
        a += t * jerk
        time -= t
    return q, v, a


@compiled(
    returns(boolean, boolean, boolean, float64)(
        reads(2), views(1), record(Limits, *4 * [writes(1)]), views(2), views(1), views(1), STOP
    )
)
def plan_stop(
    state: Array, here: Array, limits: Limits, coupling: Array, lows: Array, highs: Array, stop: Stop
) -> tuple[bool, bool, bool, float]:
    """Plans the fastest stop of n servos from a `state` (3, n): angles [rad], velocities [rad/s] and
    accelerations [rad/s2]. Writes the stop into `stop`.

    Returns three truth values and the duration [s] of the stop:

    - The first is True if all angles stay inside their limits, or no farther outside than `here` (n,) [rad],
      the angles one period before the stop. A servo that has come inside its limits must not leave them
      again.
    - The second is True if the couplings are kept for all angles that the stop may pass: each weighted sum
      `coupling` (m, n) @ angles is from `lows` to `highs` (m,).
    - The third is True if an angle in `state` is already outside its limits.
    """
    inside, outside, duration = True, False, 0.0
    for i in range(len(here)):
        q, v, a, jerk = state[0, i], state[1, i], state[2, i], limits.jerk[i]
        lower, upper = limits.lower[i], limits.upper[i]
        stop.here[i], stop.angle[i], stop.speed[i], stop.pull[i] = here[i], q, v, a
        _plan(stop, i, limits.acceleration[i], jerk)
        lasts = stop.ramp[i] + stop.plateau[i] + stop.release[i]
        duration = max(duration, lasts)
        end, _, _ = _follow(stop, i, np.inf)
        stop.end[i] = end
        # A servo turns back when its acceleration alone takes it through zero velocity, even while the jerk
        # takes the acceleration away as fast as it may.
        turn, square = q, a * a - 2.0 * jerk * abs(v)
        if v * a < 0.0 and square > 0.0:
            time = (abs(a) - np.sqrt(square)) / jerk
            turn = q + time * (v + time * (a / 2.0 - time * np.sign(a) * jerk / 6.0))
        stop.span[0, i] = min(q, turn, end)
        stop.span[1, i] = max(q, turn, end)
        if not (stop.span[0, i] >= min(lower, here[i]) and stop.span[1, i] <= max(upper, here[i])):
            inside = False
        within = False
        for at in (q, turn, end):
            if within and not lower <= at <= upper:
                inside = False
            within = within or lower <= at <= upper
        if not (np.isfinite(q + v + a) and np.isfinite(turn) and np.isfinite(end)):
            inside = False  # min and max of NaN depend on the order of arguments
        outside = outside or q < lower or q > upper
    return inside, box_keeps(stop.span, coupling, lows, highs), outside, duration


@compiled(void(STOP, reads(1), writes(3)))
def follow_stop(stop: Stop, times: Array, states: Array) -> None:
    """Computes the motion of n servos during a stop that `plan_stop` has written into `stop`. Writes
    angles [rad], velocities [rad/s] and accelerations [rad/s2] at `times` (k,) [s] after the stop began into
    `states` (k, 3, n)."""
    for k in range(len(times)):
        for i in range(len(stop.end)):
            if times[k] < stop.ramp[i] + stop.plateau[i] + stop.release[i]:
                states[k, 0, i], states[k, 1, i], states[k, 2, i] = _follow(stop, i, times[k])
            else:
                states[k, 0, i], states[k, 1, i], states[k, 2, i] = stop.end[i], 0.0, 0.0


@compiled(void(views(1, int64), views(1), views(1), reads(2), writes(2)))
def take_room(index: NDArray[np.intp], measured: Array, reference: Array, span: Array, box: Array) -> None:
    """Computes the range of angles that servos may pass while they stop, and writes their least and largest
    angles [rad] into `box` (2, n_servos).

    `index` (n,) are the indices of these servos. During the stop, the references are between the rows of
    `span` (2, n) [rad]. If a servo's angle in `measured` (n_servos,) [rad] is now above or below its
    `reference` (n,) [rad], its range is extended by the difference on this side.
    """
    for i in range(len(index)):
        servo = index[i]
        deviation = measured[servo] - reference[i]
        box[0, servo] = span[0, i] + min(deviation, 0.0)
        box[1, servo] = span[1, i] + max(deviation, 0.0)
