"""Generic joints that are linear combinations of servos, in one compiled loop."""

from __future__ import annotations

import numpy as np
from numba import int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, writes
from tci.frames import Array


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
    """Writes the angles [rad] of the generic joints `ids` (k,) into `generic` (n,).

    The angle of joint `ids[j]` is `offsets[j]` plus the sum of `factors[i]` times the `position` (n_servos,)
    [rad] of the servo `servos[i]`, over all i from `begin[j]` to `begin[j + 1]` - 1. `begin` has the shape (k
    + 1,). No sum is empty.
    """
    for j in range(len(ids)):
        i = begin[j]
        angle = factors[i] * position[servos[i]]
        for other in range(i + 1, begin[j + 1]):
            angle += factors[other] * position[servos[other]]
        generic[ids[j]] = angle + offsets[j]
