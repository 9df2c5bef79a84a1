"""What a planned stop passes through."""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, views, writes
from tci.frames import Array


@compiled(boolean(reads(2), reads(1), reads(1), reads(1), reads(1), reads(1), writes(2)))
def stop_stays_inside(
    start: Array, end: Array, jerk: Array, here: Array, lower: Array, upper: Array, span: Array
) -> bool:
    """Whether a stop stays in `lower`, `upper` (n,) [rad], or outside them no farther than `here` (n,), and
    does not leave them again once it is inside.

    It goes from `start` (3, n), angles, velocities and accelerations [rad], to `end` (n,) with `jerk` (n,)
    [rad/s3]. Writes the least and the largest angles (2, n) on the way into `span`. A servo turns back when
    its acceleration alone takes it through zero velocity, even while `jerk` takes the acceleration away as
    fast as it may. (`Trajectory.position_extrema` is wrong for a stop: it counts 0 in.)
    """
    inside = True
    for i in range(len(end)):
        q, v, a = start[0, i], start[1, i], start[2, i]
        turn, square = q, a * a - 2.0 * jerk[i] * abs(v)
        if v * a < 0.0 and square > 0.0:
            time = (abs(a) - np.sqrt(square)) / jerk[i]
            turn = q + time * (v + time * (a / 2.0 - time * np.sign(a) * jerk[i] / 6.0))
        span[0, i] = min(q, turn, end[i])
        span[1, i] = max(q, turn, end[i])
        if not (span[0, i] >= min(lower[i], here[i]) and span[1, i] <= max(upper[i], here[i])):
            inside = False
        within = False
        for at in (q, turn, end[i]):
            if within and not lower[i] <= at <= upper[i]:
                inside = False
            within = within or lower[i] <= at <= upper[i]
        if not (np.isfinite(q + v + a) and np.isfinite(turn) and np.isfinite(end[i])):
            inside = False  # min and max of numbers that are none depend on their order
    return inside


@compiled(boolean(views(1), views(1), views(1)))
def is_outside(here: Array, lower: Array, upper: Array) -> bool:
    """Whether any angle of `here` (n,) is outside `lower`, `upper` (n,)."""
    outside = False
    for i in range(len(here)):
        outside = outside or here[i] < lower[i] or here[i] > upper[i]
    return outside


@compiled(void(views(1, int64), views(1), views(1), reads(2), writes(2)))
def take_room(index: NDArray[np.intp], measured: Array, told: Array, span: Array, box: Array) -> None:
    """Write into `box` (2, n_servos) the least and the largest angles that servos `index` (n,) pass through.

    They are told to stay in `span` (2, n), and may be moved from it by what they are away now: `measured`
    (n_servos,) from `told` (n,). All in [rad].
    """
    for i in range(len(index)):
        servo = index[i]
        away = measured[servo] - told[i]
        box[0, servo] = span[0, i] + min(away, 0.0)
        box[1, servo] = span[1, i] + max(away, 0.0)
