"""Couplings: limits of weighted sums of the angles of servos that move together, for example because of
cables. Used by `tci.gate.bounds`."""

from __future__ import annotations

import numpy as np
from numba import boolean, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, views, writes

MARGIN = 1e-6
"""Distance [rad] that targets keep from limits and from bounds of couplings. Assumed: larger than the
rounding errors of ruckig, the library that plans motions."""
SWEEPS = 50
"""Largest number of passes in which `project` moves a point inside the couplings, so that a call takes a
limited time. Assumed: later passes change little."""


@inlined
def project(
    lower: Array, upper: Array, target: Array, coupling: Array, lows: Array, highs: Array,
    free: NDArray[np.bool_], point: Array,
) -> None:  # fmt: skip
    """Moves the angles `target` (n,) [rad] inside limits and couplings, and writes the result into `point`
    (n,) [rad]. Then each angle is from `lower` to `upper` (n,) [rad], and each weighted sum `coupling` (m, n)
    @ point from `lows` to `highs` (m,).

    Moves only servos for which `free` (n,) is True. The point keeps a small margin from all bounds; between
    two bounds that are too close together for this margin, it is in the middle. Method: Bregman 1965.
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
    """Moves the angles `target` (n,) [rad] inside limits (from `lower` to `upper`) and couplings (weighted
    sums `coupling` @ point, from `lows` to `highs`), and writes the result into `point` (n,) [rad]. Moves
    only servos for which `free` (n,) is True."""
    project(lower, upper, target, coupling, lows, highs, free, point)


@inlined
def box_keeps(span: Array, coupling: Array, lows: Array, highs: Array) -> bool:
    """Returns True if all combinations of n angles between the two rows of `span` (2, n) [rad] keep the
    couplings: each weighted sum `coupling` (m, n) @ angles is from `lows` (m,) to `highs` (m,)."""
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
    """Computes the bounds within which a group of servos must keep the couplings (weighted sums of angles),
    while the servos outside the group stay at `measured` (n_servos,) [rad]. Writes into `lower` and `upper`
    (m,) the couplings' bounds `lows` and `highs` (m,), minus the part of each sum that comes from servos
    outside the group.

    `outside` (m, n_servos) are the coefficients of the servos outside the group, and 0 for servos in the
    group.
    """
    for m in range(len(lows)):
        taken = 0.0
        for i in range(len(measured)):
            taken += outside[m, i] * measured[i]
        lower[m], upper[m] = lows[m] - taken, highs[m] - taken
