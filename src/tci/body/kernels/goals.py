"""The angles to which the gate moves servos that are asked for others: within limits and couplings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, void
from numpy.typing import NDArray

from tci.gate.kernels.couplings import project
from tci.messages.frames import Array
from tci.support.compiled import compiled, reads, record, writes


class Within(NamedTuple):
    """Limits of k servos that move together, and the m couplings in which one of them occurs."""

    lower: Array
    """Smallest angles (k,) [rad]."""
    upper: Array
    coupling: Array
    """Coefficients (m, k) of the couplings: coupling_lower <= coupling @ angles <= coupling_upper."""
    coupling_lower: Array
    coupling_upper: Array
    outside: Array
    """Coefficients (m, n_servos) of the other servos, which shift the bounds of the couplings."""
    free: NDArray[np.bool_]
    """Mask (k,) of the servos that a coupling may turn aside."""


@compiled(
    void(
        reads(1),
        record(Within, reads(1), reads(1), reads(2), reads(1), reads(1), reads(2), reads(1, boolean)),
        writes(2),
        writes(2),
    )
)
def keep_within(position: Array, within: Within, goals: Array, bounds: Array) -> None:
    """Changes each of `goals` (g, k) [rad] to the nearest angles that are permitted while the servos of other
    parts stay at `position` (n_servos,) [rad]. `bounds` (2, m) is room for the couplings' bounds."""
    for goal in goals:
        for i in range(len(goal)):
            goal[i] = min(max(goal[i], within.lower[i]), within.upper[i])
        kept = True
        for m in range(len(within.coupling_lower)):
            taken = value = 0.0
            for i in range(len(position)):
                taken += within.outside[m, i] * position[i]
            for i in range(len(goal)):
                value += within.coupling[m, i] * goal[i]
            bounds[0, m] = within.coupling_lower[m] - taken
            bounds[1, m] = within.coupling_upper[m] - taken
            kept = kept and bounds[0, m] <= value <= bounds[1, m]
        if not kept:
            project(
                within.lower, within.upper, goal, within.coupling, bounds[0], bounds[1], within.free, goal
            )  # fmt: skip
