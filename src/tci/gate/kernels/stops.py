"""Compiled loops that plan, check and evaluate the jerk-limited stops of servos."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.gate.kernels.couplings import box_keeps
from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, returns, views, writes

LOWER, UPPER, ACCELERATION, JERK = range(4)
"""Rows of the limits (4, n) of n servos: lower and upper angles [rad], acceleration [rad/s2] and jerk
[rad/s3]."""
(
    LEAST, MOST, HERE, END, ANGLE, SPEED, PULL, FIRST_JERK, LAST_JERK, RAMP, PLATEAU, RELEASE,
    STOP_ROWS,
) = range(13)  # fmt: skip
"""Rows of a planned stop (12, n) of n servos; `STOP_ROWS` is their number:

- least and largest angle [rad] during the stop
- angle [rad] one period before the stop, and at its end
- angle [rad], velocity [rad/s] and acceleration [rad/s2] at its start
- jerk [rad/s3] while the braking acceleration builds up, and while it returns to zero
- durations [s] for which the braking acceleration builds up, stays constant, and returns to zero
"""


@inlined
def _plan(stop: Array, i: int, most: float, jerk: float) -> None:
    """Plans the fastest stop of servo `i` with accelerations up to `most` [rad/s2] and the `jerk` [rad/s3],
    and writes its jerks and durations into `stop` (12, n), which already contains the state from which the
    servo stops."""
    v, a = stop[SPEED, i], stop[PULL, i]
    final = v + a * abs(a) / (2.0 * jerk)  # velocity if the acceleration were released at once
    peak = a
    if final > 0.0:
        peak = -min(np.sqrt(jerk * v + a * a / 2.0), most)
    elif final < 0.0:
        peak = min(np.sqrt(a * a / 2.0 - jerk * v), most)
    ramp, release = abs(peak - a) / jerk, abs(peak) / jerk
    gained = (a + peak) / 2.0 * ramp + peak / 2.0 * release
    plateau = 0.0 if peak == 0.0 else max(-(v + gained) / peak, 0.0)
    stop[FIRST_JERK, i] = jerk if peak > a else -jerk
    stop[LAST_JERK, i] = jerk if peak < 0.0 else -jerk
    stop[RAMP, i], stop[RELEASE, i] = ramp, release
    # Without a plateau the remaining velocity is rounding.
    stop[PLATEAU, i] = plateau if abs(peak) >= most else 0.0


@inlined
def _follow(stop: Array, i: int, time: float) -> tuple[float, float, float]:
    """Returns angle [rad], velocity [rad/s] and acceleration [rad/s2] of servo `i` at `time` [s] after it
    began to stop. `stop` (12, n) is the planned stop, with the rows listed at `STOP_ROWS`."""
    q, v, a = stop[ANGLE, i], stop[SPEED, i], stop[PULL, i]
    for jerk, lasts in (
        (stop[FIRST_JERK, i], stop[RAMP, i]),
        (0.0, stop[PLATEAU, i]),
        (stop[LAST_JERK, i], stop[RELEASE, i]),
    ):
        t = min(time, lasts)
        q += t * (v + t * (a / 2.0 + t * jerk / 6.0))
        v += t * (a + t * jerk / 2.0)
        a += t * jerk
        time -= t
    return q, v, a


@compiled(
    returns(boolean, boolean, boolean, float64)(
        reads(2), views(1), reads(2), views(2), views(1), views(1), writes(2)
    )
)
def plan_stop(
    state: Array, here: Array, limits: Array, coupling: Array, lows: Array, highs: Array, stop: Array
) -> tuple[bool, bool, bool, float]:
    """Plans the fastest stop of n servos from a `state` (3, n): angles [rad], velocities [rad/s] and
    accelerations [rad/s2]. Writes the stop into `stop` (12, n), with the rows listed at `STOP_ROWS`.

    Returns three truth values and the duration [s] of the stop:

    - The first is True if all angles stay inside their limits, or no farther outside than `here` (n,) [rad],
      the angles one period before the stop. A servo that has come inside its limits must not leave them
      again. The rows of `limits` (4, n) are lower and upper angles, accelerations and jerks.
    - The second is True if the couplings are kept for all angles that the stop may pass: each weighted sum
      `coupling` (m, n) @ angles is from `lows` to `highs` (m,).
    - The third is True if an angle in `state` is already outside its limits.
    """
    inside, outside, duration = True, False, 0.0
    for i in range(len(here)):
        q, v, a, jerk = state[0, i], state[1, i], state[2, i], limits[JERK, i]
        lower, upper = limits[LOWER, i], limits[UPPER, i]
        stop[HERE, i], stop[ANGLE, i], stop[SPEED, i], stop[PULL, i] = here[i], q, v, a
        _plan(stop, i, limits[ACCELERATION, i], jerk)
        lasts = stop[RAMP, i] + stop[PLATEAU, i] + stop[RELEASE, i]
        duration = max(duration, lasts)
        end, _, _ = _follow(stop, i, np.inf)
        stop[END, i] = end
        # A servo turns back when its acceleration alone takes it through zero velocity, even while the jerk
        # takes the acceleration away as fast as it may.
        turn, square = q, a * a - 2.0 * jerk * abs(v)
        if v * a < 0.0 and square > 0.0:
            time = (abs(a) - np.sqrt(square)) / jerk
            turn = q + time * (v + time * (a / 2.0 - time * np.sign(a) * jerk / 6.0))
        stop[LEAST, i] = min(q, turn, end)
        stop[MOST, i] = max(q, turn, end)
        if not (stop[LEAST, i] >= min(lower, here[i]) and stop[MOST, i] <= max(upper, here[i])):
            inside = False
        within = False
        for at in (q, turn, end):
            if within and not lower <= at <= upper:
                inside = False
            within = within or lower <= at <= upper
        if not (np.isfinite(q + v + a) and np.isfinite(turn) and np.isfinite(end)):
            inside = False  # min and max of NaN depend on the order of arguments
        outside = outside or q < lower or q > upper
    return inside, box_keeps(stop[: MOST + 1], coupling, lows, highs), outside, duration


@compiled(void(reads(2), reads(1), writes(3)))
def follow_stop(stop: Array, times: Array, states: Array) -> None:
    """Computes the motion of n servos during a stop that `plan_stop` has written into `stop` (12, n). Writes
    angles [rad], velocities [rad/s] and accelerations [rad/s2] at `times` (k,) [s] after the stop began into
    `states` (k, 3, n)."""
    for k in range(len(times)):
        for i in range(stop.shape[1]):
            if times[k] < stop[RAMP, i] + stop[PLATEAU, i] + stop[RELEASE, i]:
                states[k, 0, i], states[k, 1, i], states[k, 2, i] = _follow(stop, i, times[k])
            else:
                states[k, 0, i], states[k, 1, i], states[k, 2, i] = stop[END, i], 0.0, 0.0


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
