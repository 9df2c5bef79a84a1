"""Targets of a command to servos that move together."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, views, writes
from tci.frames import Array
from tci.gate.kernels.couplings import project

LOWER, UPPER, FASTEST = range(3)
"""Rows of the limits of a joint group: angles [rad], and speed [rad/s]."""
TARGET, SPEED, WANTED = range(3)
"""Rows of a joint group's aims; the last is work space."""


@compiled(boolean(reads(1, int64), reads(1), reads(1), int64, float64))
def is_acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Returns True if `servos` (k,), out of `count`, are valid and occur once, `values` (k,) are finite and
    `speeds` (k,) at least `slowest`."""
    for k in range(len(servos)):
        if not (0 <= servos[k] < count and np.isfinite(values[k]) and speeds[k] >= slowest):
            return False
        for before in range(k):
            if servos[before] == servos[k]:
                return False
    return len(servos) > 0


@compiled(boolean(reads(1, int64), reads(1), reads(1), reads(1), float64))
def is_far_off(servos: NDArray[np.intp], values: Array, lower: Array, upper: Array, far: float) -> bool:
    """Returns True if an angle of `values` (k,) [rad] of `servos` (k,) is so large that it may be in degrees.

    This is true for an angle that is outside `lower` .. `upper` (n_servos,) [rad] and beyond a full turn, and
    for two angles or more that are all outside by more than `far` [rad].
    """
    near = len(servos) < 2
    for k in range(len(servos)):
        outside = max(lower[servos[k]] - values[k], values[k] - upper[servos[k]])
        if outside > 0.0 and abs(values[k]) > 2.0 * np.pi:
            return True
        near = near or outside <= far
    return not near


@compiled(
    float64(
        reads(1, int64), reads(1, int64), reads(1), reads(1), reads(2), views(2), views(2),
        writes(1, boolean), writes(2), writes(1),
    )
)  # fmt: skip
def take_targets(
    index: NDArray[np.intp], servos: NDArray[np.intp], values: Array, speeds: Array, limits: Array,
    coupling: Array, ends: Array, free: NDArray[np.bool_], aims: Array, sent: Array,
) -> float:  # fmt: skip
    """Sets the targets of the servos `index` (n,) of a joint group from the `values` (k,) of a command.

    Returns the largest distance [rad] of a servo's target from its value. Writes into `aims` (3, n) targets
    [rad] inside `limits` and couplings, and the `speeds` (k,), at most the fastest of the `limits` (3, n);
    and into `sent` (k,) the targets of those of `servos` (k,) that are in the group. For `coupling` (m, n)
    and its `ends` (2, m) see `Bounds`; `free` (n,) and the last row of `aims` are work space.
    """
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
    """Writes the largest `limits` (3, n) within `speed`, `acceleration`, `jerk` (n,) that are proportional to
    the distances from `here` to `target` (n,): with these, all servos move in a straight line.

    A longest distance below `still` counts as `still`, and a distance below the fraction `least` of the
    longest as that fraction.
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
