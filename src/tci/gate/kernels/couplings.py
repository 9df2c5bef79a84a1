"""Couplings: linear inequalities between the angles of servos that move together. Used by
`tci.gate.bounds`."""

from __future__ import annotations

import numpy as np
from numba import boolean, void
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, views, writes
from tci.frames import Array

MARGIN = 1e-6
"""Distance [rad] that targets keep from limits and from bounds of couplings. Assumed: larger than ruckig's
rounding errors."""
SWEEPS = 50
"""Largest number of sweeps over all couplings in `project`. This number bounds the time of a call. Assumed:
later sweeps change little."""


@inlined
def project(
    lower: Array, upper: Array, target: Array, coupling: Array, lows: Array, highs: Array,
    free: NDArray[np.bool_], point: Array,
) -> None:  # fmt: skip
    """Writes a `point` (n,) [rad] near `target` (n,) [rad] that is inside `lower` and `upper` (n,) [rad], and
    for which `lows` <= `coupling` @ point <= `highs` (m,).

    The point keeps a margin from all bounds. If two bounds are too close together for this margin, the point
    is in the middle between them. The point differs from `target` only for servos that are `free` (n,). The
    function projects the point onto each violated half-space and each violated limit in turn (Bregman 1965).
    """
    for i in range(len(target)):
        point[i] = target[i]
        if free[i]:
            room = min(MARGIN, (upper[i] - lower[i]) / 2)
            point[i] = min(max(target[i], lower[i] + room), upper[i] - room)
    for _ in range(SWEEPS):
        inside = True
        for m in range(len(lows)):
            room = min(MARGIN, (highs[m] - lows[m]) / 2)
            value = 0.0
            for i in range(len(target)):
                value += coupling[m, i] * point[i]
            if not lows[m] + room - room / 2 <= value <= highs[m] - room + room / 2:
                inside = False
        if inside:
            return
        for m in range(len(lows)):
            room = min(MARGIN, (highs[m] - lows[m]) / 2)
            value = share = 0.0
            for i in range(len(target)):
                value += coupling[m, i] * point[i]
                if free[i]:
                    share += coupling[m, i] * coupling[m, i]
            nearest = min(max(value, lows[m] + room), highs[m] - room)
            if not share > 0.0 or nearest == value:
                continue
            for i in range(len(target)):
                if free[i]:
                    room = min(MARGIN, (upper[i] - lower[i]) / 2)
                    moved = point[i] + coupling[m, i] * (nearest - value) / share
                    point[i] = min(max(moved, lower[i] + room), upper[i] - room)


@compiled(
    void(views(1), views(1), views(1), views(2), views(1), views(1), views(1, boolean), writes(1))
)  # fmt: skip
def find_nearest(
    lower: Array, upper: Array, target: Array, coupling: Array, lows: Array, highs: Array,
    free: NDArray[np.bool_], point: Array,
) -> None:  # fmt: skip
    """Writes a `point` (n,) [rad] near `target` (n,) [rad] that is inside limits and couplings. This is
    `project` for calls from Python."""
    project(lower, upper, target, coupling, lows, highs, free, point)


@inlined
def box_keeps(span: Array, coupling: Array, lows: Array, highs: Array) -> bool:
    """Returns True if `lows` (m,) <= `coupling` (m, n) @ point <= `highs` (m,) for all points of a box. The
    rows of `span` (2, n) [rad] are opposite corners of the box."""
    for m in range(len(lows)):
        least = most = 0.0
        for i in range(span.shape[1]):
            one, other = coupling[m, i] * span[0, i], coupling[m, i] * span[1, i]
            least += min(one, other)
            most += max(one, other)
        if not (least >= lows[m] and most <= highs[m]):
            return False
    return True


@compiled(void(views(2), views(1), views(1), views(1), writes(1), writes(1)))
def shift(outside: Array, measured: Array, lows: Array, highs: Array, lower: Array, upper: Array) -> None:
    """Writes bounds for the contribution of the servos in the group to each coupling: `lower` and `upper`
    (m,) are the couplings' bounds `lows` and `highs` (m,) minus the contribution of the servos outside the
    group.

    The servos outside the group are at `measured` (n_servos,) [rad] and have the coefficients `outside` (m,
    n_servos).
    """
    for m in range(len(lows)):
        taken = 0.0
        for i in range(len(measured)):
            taken += outside[m, i] * measured[i]
        lower[m], upper[m] = lows[m] - taken, highs[m] - taken
