"""Compiled loops for generic joints that are combinations of servos."""

from __future__ import annotations

import numpy as np
from numba import int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, reads, writes


@compiled(void(reads(1), reads(1, int64), reads(1, int64), reads(1, int64), reads(1), reads(1), writes(1)))
def combine_servos(
    position: Array,
    ids: NDArray[np.int64],
    begin: NDArray[np.int64],
    servos: NDArray[np.int64],
    factors: Array,
    offsets: Array,
    generic: Array,
) -> None:
    """Computes the generic joints whose angles are weighted sums of servo angles. Writes their angles [rad]
    into `generic` (n,), at the indices `ids` (k,).

    The angle of the joint `ids[j]` is `offsets[j]` [rad] plus the sum of its terms. `servos` (t,) and
    `factors` (t,) list the terms of all joints: a term is a factor times the angle of one servo in `position`
    (n_servos,) [rad]. The joint `ids[j]` has the terms `begin[j]` to `begin[j + 1]` - 1, at least one; so
    `begin` has the shape (k + 1,).
    """
    for j in range(len(ids)):
        i = begin[j]
        angle = factors[i] * position[servos[i]]
        for other in range(i + 1, begin[j + 1]):
            angle += factors[other] * position[servos[other]]
        generic[ids[j]] = angle + offsets[j]


@compiled(void(reads(3), reads(1), writes(1), writes(1)))
def limit_servos(slopes: Array, most: Array, sizes: Array, speeds: Array) -> None:
    """Writes servo speeds (k,) [rad/s] at which no joint exceeds `most` (m,) [rad/s] in any of p postures,
    even if all servos move this joint at once, into `speeds`.

    The condition is `sum_j |slope[i, j]| speed[j] <= most[i]`, with the largest size of each slope. `slopes`
    (p, m, k) are d generic / d servo. `sizes` (k,) is overwritten.
    """
    speeds[:] = np.inf
    for i in range(len(most)):
        total = 0.0
        for j in range(len(speeds)):
            sizes[j] = 0.0
            for p in range(len(slopes)):
                sizes[j] = max(sizes[j], abs(slopes[p, i, j]))
            total += sizes[j]
        for j in range(len(speeds)):
            if sizes[j] > 0.0:
                speeds[j] = min(speeds[j], most[i] / total)
