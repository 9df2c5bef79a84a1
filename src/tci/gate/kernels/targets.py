"""Computation of targets for a command to servos that move together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.gate.kernels.couplings import project
from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, returns, views, writes

LOWER, UPPER, FASTEST = range(3)
"""Rows of the limits (3, n) of a joint group (n servos that move together): lower and upper angles [rad], and
speeds [rad/s]."""
TARGET, SPEED, WANTED = range(3)
"""Rows of the targets (3, n) of a joint group (n servos that move together): targets [rad], speeds [rad/s],
and a row for intermediate results."""
INVALID, FAR_OFF = -1.0, -2.0
"""Results of `take_targets` for a command that must be refused. INVALID: the command contains invalid
numbers. FAR_OFF: its angles are so far outside their limits that they may be in degrees."""

COMMAND = returns(views(1, int64), views(1), views(1))
"""Numba types of a command to k servos: indices `servos` (k,), angles `values` (k,) [rad] and `speeds` (k,)
[rad/s]."""
GROUP = returns(reads(1, int64), reads(2), views(2), reads(2), writes(1, boolean), writes(2))
"""Numba types of the arrays of a joint group (n servos that move together, with m couplings): servo indices
`index` (n,), `limits` (3, n), coefficients `coupling` (m, n) with bounds `ends` (2, m), `free` (n,), which is
True for commanded servos, and targets `aims` (3, n)."""


@inlined
def acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Returns True if a command to a robot with `count` servos is valid: at least one servo, all indices
    `servos` (k,) different and from 0 to `count` - 1, `values` (k,) finite, and `speeds` (k,) at least
    `slowest` [rad/s]."""
    for k in range(len(servos)):
        if not (0 <= servos[k] < count and np.isfinite(values[k]) and speeds[k] >= slowest):
            return False
        for before in range(k):
            if servos[before] == servos[k]:
                return False
    return len(servos) > 0


@compiled(boolean(views(1, int64), views(1), views(1), int64, float64))
def is_acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Returns True if a command to a robot with `count` servos is valid.

    The indices `servos` (k,) must be different and from 0 to `count` - 1, at least one. `values` (k,) must be
    finite, and `speeds` (k,) at least `slowest` [rad/s].
    """
    valid: bool = acceptable(servos, values, speeds, count, slowest)
    return valid


@inlined
def far_off(servos: NDArray[np.intp], values: Array, box: Array, far: float) -> bool:
    """Returns True if the angles `values` (k,) of a command to `servos` (k,) may be in degrees: one is
    outside its limits in `box` (2, n_servos) [rad] and larger than a full turn, or there are several and each
    is outside by more than `far` [rad]."""
    near = len(servos) < 2
    for k in range(len(servos)):
        outside = max(box[LOWER, servos[k]] - values[k], values[k] - box[UPPER, servos[k]])
        if outside > 0.0 and abs(values[k]) > 2.0 * np.pi:
            return True
        near = near or outside <= far
    return not near


@compiled(boolean(views(1, int64), views(1), reads(2), float64))
def is_far_off(servos: NDArray[np.intp], values: Array, box: Array, far: float) -> bool:
    """Returns True if the angles of a command may be in degrees instead of radians.

    There are two cases: one of the angles `values` (k,) is outside its limits in `box` (2, n_servos) [rad]
    and larger than a full turn (2 pi); or there are several, and each is outside by more than `far` [rad].
    `servos` (k,) are the commanded servos.
    """
    large: bool = far_off(servos, values, box, far)
    return large


@compiled(float64(COMMAND, reads(2), float64, float64, GROUP, writes(1)))
def take_targets(
    command: tuple[NDArray[Any], ...], box: Array, far: float, slowest: float,
    group: tuple[NDArray[Any], ...], sent: Array,
) -> float:  # fmt: skip
    """Checks a command, and sets the targets of the servos of one joint group (servos that move together).
    `command` and `group` contain the arrays listed at `COMMAND` and `GROUP`.

    Returns the largest distance [rad] of a target from the angle in the command. If the command must be
    refused, writes nothing and returns INVALID (indices or angles are invalid, or a speed is below `slowest`
    [rad/s]) or FAR_OFF (angles may be in degrees: `is_far_off` describes the rule, and its arguments `box`
    and `far`).

    Writes into `aims` (3, n) of the group the targets [rad] (row 0), which are inside limits and couplings,
    and the speeds [rad/s] (row 1), which are inside the speed limits. Writes into `sent` (k,) [rad] the
    targets of those commanded servos that are in the group.
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
    """Computes limits of speed, acceleration and jerk with which n servos move along a straight line in the
    space of their angles, and writes these as rows into `limits` (3, n).

    The line leads from `here` (n,) [rad] to `target` (n,) [rad].

    The limits of a servo are proportional to its distance, and as large as the servos' own limits `speed`,
    `acceleration` and `jerk` (n,) allow. The longest distance counts as at least `still` [rad], and each
    other distance as at least the fraction `least` of the longest.
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
