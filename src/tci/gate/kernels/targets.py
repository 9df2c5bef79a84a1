"""What a command asks of servos that move together."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, views, writes
from tci.frames import Array


@compiled(boolean(reads(1, int64), reads(1), reads(1), int64, float64))
def is_acceptable(servos: NDArray[np.intp], values: Array, speeds: Array, count: int, slowest: float) -> bool:
    """Whether there are `servos` (k,), of `count`, each only once, with `values` (k,) that are finite and
    `speeds` (k,) of at least `slowest`."""
    for k in range(len(servos)):
        if not (0 <= servos[k] < count and np.isfinite(values[k]) and speeds[k] >= slowest):
            return False
        for before in range(k):
            if servos[before] == servos[k]:
                return False
    return len(servos) > 0


@compiled(boolean(reads(1, int64), reads(1), reads(1), reads(1), float64))
def is_far_off(servos: NDArray[np.intp], values: Array, lower: Array, upper: Array, far: float) -> bool:
    """Whether one of the angles `values` (k,) [rad] of `servos` (k,) is outside `lower` .. `upper`
    (n_servos,) [rad] and beyond a full turn, or all of at least two are outside by more than `far` [rad]."""
    near = len(servos) < 2
    for k in range(len(servos)):
        outside = max(lower[servos[k]] - values[k], values[k] - upper[servos[k]])
        if outside > 0.0 and abs(values[k]) > 2.0 * np.pi:
            return True
        near = near or outside <= far
    return not near


@compiled(
    void(
        reads(1, int64), reads(1, int64), reads(1), reads(1), views(1), views(1), views(1), float64,
        writes(1), writes(1), writes(1, boolean),
    )
)  # fmt: skip
def put_in_place(
    index: NDArray[np.intp], servos: NDArray[np.intp], values: Array, speeds: Array,
    lower: Array, upper: Array, fastest: Array, margin: float,
    target: Array, speed: Array, asked: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write `values` and `speeds` (k,) of `servos` into the places (n,) that they have in `index` (n,), and
    which of those are `asked` (n,). Servos that are not there are left out.

    Values are clamped to `lower`, `upper` (n,) and a `margin` away from them, or half of the way between
    them; speeds are at most the `fastest` (n,).
    """
    for i in range(len(index)):
        asked[i] = False
        room = min(margin, (upper[i] - lower[i]) / 2)
        for k in range(len(servos)):
            if servos[k] == index[i]:
                target[i] = min(max(values[k], lower[i] + room), upper[i] - room)
                speed[i] = min(speeds[k], fastest[i])
                asked[i] = True


@compiled(void(reads(1, int64), reads(1, int64), reads(1), writes(1)))
def pick_out(index: NDArray[np.intp], servos: NDArray[np.intp], values: Array, found: Array) -> None:
    """Write into `found` (k,) what `values` (n,) say of `servos` (k,) at their places in `index` (n,)."""
    for i in range(len(index)):
        for k in range(len(servos)):
            if servos[k] == index[i]:
                found[k] = values[i]


@compiled(void(views(1), views(1), views(1), views(1), views(1), float64, float64, writes(2)))
def straight_limits(
    here: Array, target: Array, speed: Array, acceleration: Array, jerk: Array,
    still: float, least: float, limits: Array,
) -> None:  # fmt: skip
    """Write the largest `limits` (3, n) within `speed`, `acceleration`, `jerk` (n,) that are in the ratio of
    the ways from `here` to `target` (n,): with these, all go in a straight line.

    A longest way below `still` counts as that, and a way below the share `least` of the longest as that.
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
