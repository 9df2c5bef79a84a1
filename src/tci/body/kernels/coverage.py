"""Counts the taxels around places of a generic limb, and how many of these taxels are masked (not
trusted)."""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.kernels.limb import limb_pose
from tci.robot.limb import RHO
from tci.support.compiled import compiled, reads, writes

SEGMENT, X, Y, Z, RADIUS = range(5)
"""Row numbers in a table of places on arms: segment (0 upper arm, 1 forearm), a point on the generic limb,
and a radius around this point, both in limb lengths."""
LENGTH, SIDE, PLACE = 12, 13, 14
"""Column numbers in a table with one arm segment in each row: length [m] of the segment, side (+1 left, -1
right), and segment (0 upper arm, 1 forearm)."""


@compiled(
    void(
        reads(3), reads(2, int64), reads(2), reads(1), reads(2), reads(1, int64), reads(1, boolean), reads(2),
        writes(2),
    ),
    seldom=True,
)  # fmt: skip
def count_taxels(
    poses: Array,
    on: NDArray[np.int64],
    limb: Array,
    posture: Array,
    positions: Array,
    begins: NDArray[np.int64],
    masked: NDArray[np.bool_],
    places: Array,
    counts: Array,
) -> None:
    """Counts the taxels of p patches on an arm around each of m places, and how many of these taxels are
    masked (not trusted).

    Args: poses: Poses (l, 4, 4) of l links in the torso frame. on: Indices (p, 2) in `poses`: for each patch,
        its link and the link of its arm segment. limb: Result (p, 15) of `limb_numbers` for each patch.
        posture: Generic angles [rad] of the arm. positions: Positions (n, 3) [m] of the taxels, each in the
        link of its patch. begins: Index (p + 1,) in `positions` of the first taxel of each patch; the last is
        n. masked: Mask (n,) of masked taxels. places: Table (5, m) with one column for each place: segment (0
        upper arm, 1 forearm), three coordinates of a point on the generic limb, and radius around this point,
        both in limb lengths. counts: Output (2, m): the numbers of all taxels (row 0) and of masked taxels
        (row 1) are added to it.
    """
    for p in range(len(on)):
        x_S, y_S, z_S = limb_pose(poses[on[p, 0]], poses[on[p, 1]], limb[p], posture)
        for t in range(begins[p], begins[p + 1]):
            a, b, c = positions[t, 0], positions[t, 1], positions[t, 2]
            x = x_S[0] * a + x_S[1] * b + x_S[2] * c + x_S[3]
            y = limb[p, SIDE] * (y_S[0] * a + y_S[1] * b + y_S[2] * c + y_S[3])
            u = -(z_S[0] * a + z_S[1] * b + z_S[2] * c + z_S[3]) / limb[p, LENGTH]
            r = np.sqrt(x * x + y * y)
            sine, cosine = (y / r, x / r) if r > 0.0 else (0.0, 1.0)
            for m in range(places.shape[1]):
                if places[SEGMENT, m] != limb[p, PLACE]:
                    continue
                dx = u - places[X, m]
                dy = RHO * sine - places[Y, m]
                dz = RHO * cosine - places[Z, m]
                if dx * dx + dy * dy + dz * dz < places[RADIUS, m] * places[RADIUS, m]:
                    counts[0, m] += 1.0
                    counts[1, m] += 1.0 if masked[t] else 0.0
