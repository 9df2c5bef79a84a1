"""Computation of targets for a command to servos that move together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, returns, views, writes
from tci.frames import Array
from tci.gate.kernels.couplings import project

LOWER, UPPER, FASTEST = range(3)
"""Rows of the limits of a joint group (servos that move together): lower and upper angles [rad], and speeds
[rad/s]."""
TARGET, SPEED, WANTED = range(3)
"""Rows of the targets of a joint group: targets [rad], speeds [rad/s], and a row for intermediate results."""
INVALID, FAR_OFF = -1.0, -2.0
"""Results of `take_targets` for a command that must be refused: invalid numbers, and angles that are far
outside their limits."""

COMMAND = returns(views(1, int64), views(1), views(1))
"""Types of a command: `servos` (k,), `values` (k,) [rad] and `speeds` (k,) [rad/s]."""
GROUP = returns(reads(1, int64), reads(2), views(2), reads(2), writes(1, boolean), writes(2))
"""Types of the arrays of a joint group with n servos and m couplings: servo indices `index` (n,), `limits`
(3, n), coefficients `coupling` (m, n) with bounds `ends` (2, m), `free` (n,), which is True for commanded
servos, and targets `aims` (3, n)."""


@inlined
def acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Returns True if a command is valid: at least one servo, all `servos` (k,) different and from 0 to
    `count` - 1, `values` (k,) finite, and `speeds` (k,) [rad/s] at least `slowest`."""
    for k in range(len(servos)):
        if not (0 <= servos[k] < count and np.isfinite(values[k]) and speeds[k] >= slowest):
            return False
        for before in range(k):
            if servos[before] == servos[k]:
                return False
    return len(servos) > 0


@compiled(boolean(views(1, int64), views(1), views(1), int64, float64))
def is_acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Returns True if a command is valid.

    `servos` (k,) must be below `count` and occur once. `values` (k,) must be finite, and `speeds` (k,)
    [rad/s] at least `slowest`.
    """
    valid: bool = acceptable(servos, values, speeds, count, slowest)
    return valid


@inlined
def far_off(servos: NDArray[np.intp], values: Array, box: Array, far: float) -> bool:
    """Returns True if the angles `values` (k,) may be in degrees. For the rule and the other arguments see
    `is_far_off`."""
    near = len(servos) < 2
    for k in range(len(servos)):
        outside = max(box[LOWER, servos[k]] - values[k], values[k] - box[UPPER, servos[k]])
        if outside > 0.0 and abs(values[k]) > 2.0 * np.pi:
            return True
        near = near or outside <= far
    return not near


@compiled(boolean(views(1, int64), views(1), reads(2), float64))
def is_far_off(servos: NDArray[np.intp], values: Array, box: Array, far: float) -> bool:
    """Returns True if `values` (k,) [rad] of `servos` (k,) are so large that they may be in degrees.

    There are two cases: one angle is outside its limits in `box` (2, n_servos) [rad] and larger than a full
    turn; or there are two angles or more, and each is outside its limits by more than `far` [rad].
    """
    large: bool = far_off(servos, values, box, far)
    return large


@compiled(float64(COMMAND, reads(2), float64, float64, GROUP, writes(1)))
def take_targets(
    command: tuple[NDArray[Any], ...], box: Array, far: float, slowest: float,
    group: tuple[NDArray[Any], ...], sent: Array,
) -> float:  # fmt: skip
    """Sets the targets of the servos `index` (n,) of a joint group from the `values` (k,) [rad] of a command
    to `servos` (k,). A command consists of `servos`, `values` and `speeds`; a `group` consists of `index`,
    `limits`, `coupling`, `ends`, `free` and `aims`.

    Returns the largest distance [rad] of a target from its requested value. Returns INVALID if indices,
    angles or speeds are invalid (see `is_acceptable`), or FAR_OFF if the angles may be in degrees (see
    `is_far_off`); in both cases the function writes nothing. `is_far_off` describes `box` and `far`;
    `is_acceptable` describes `slowest`.

    Writes into `aims` (3, n) the targets [rad] (row 0), which are inside limits and couplings, and the speeds
    [rad/s] (row 1): the smaller of `speeds` (k,) and the speeds in `limits` (3, n). The rows of `limits` are
    lower angles, upper angles and speeds. Writes into `sent` (k,) [rad] the targets of the servos that are in
    the group. `coupling` (m, n) and its bounds `ends` (2, m) are described in `Bounds`. `free` (n,) and the
    last row of `aims` hold intermediate results.
    """
    servos, values, speeds = command
    index, limits, coupling, ends, free, aims = group
    if not acceptable(servos, values, speeds, box.shape[1], slowest):
        return INVALID
    if far_off(servos, values, box, far):
        return FAR_OFF
    for i in range(len(index)):
        free[i] = False
        aims[WANTED, i] = aims[TARGET, i]
        for k in range(len(servos)):
            if servos[k] == index[i]:
                aims[WANTED, i] = values[k]
                aims[SPEED, i] = min(speeds[k], limits[FASTEST, i])
                free[i] = True
    project(limits[LOWER], limits[UPPER], aims[WANTED], coupling, ends[0], ends[1], free, aims[TARGET])
    farthest = 0.0
    for i in range(len(index)):
        for k in range(len(servos)):
            if servos[k] == index[i]:
                sent[k] = aims[TARGET, i]
                farthest = max(farthest, abs(values[k] - sent[k]))
    return farthest


@compiled(void(views(1), views(1), views(1), views(1), views(1), float64, float64, writes(2)))
def straight_limits(
    here: Array, target: Array, speed: Array, acceleration: Array, jerk: Array,
    still: float, least: float, limits: Array,
) -> None:  # fmt: skip
    """Writes `limits` (3, n) of speed, acceleration and jerk with which servos move together along a straight
    line.

    In joint space, the line leads from `here` (n,) [rad] to `target` (n,) [rad].

    The limits of a servo are proportional to its distance, and as large as the servo's own limits `speed`,
    `acceleration` and `jerk` (n,) allow. If the longest distance is below `still` [rad], it is replaced by
    `still`. A distance that is below the fraction `least` of the longest distance is replaced by this
    fraction.
    """
    longest = still
    for i in range(len(here)):
        longest = max(longest, abs(target[i] - here[i]))
    for row, limit in enumerate((speed, acceleration, jerk)):
        most = np.inf
        for i in range(len(here)):
            share = max(abs(target[i] - here[i]) / longest, least)
            most = min(most, limit[i] / share)
        for i in range(len(here)):
            limits[row, i] = max(abs(target[i] - here[i]) / longest, least) * most
