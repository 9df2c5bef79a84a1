"""Counts the taxels around places of a generic limb, and how many of these taxels are masked (not
trusted)."""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, writes
from tci.frames import Array
from tci.robot.kernels.limb import limb_pose
from tci.robot.limb import RHO

SEGMENT, X, Y, Z, RADIUS = range(5)
"""Rows of `places`: segment, three coordinates on the generic limb, and radius [limb lengths]."""
LENGTH, SIDE, PLACE = 12, 13, 14
"""Columns of `limb`: length [m] of the segment, side (+1 left, -1 right), and index of the segment in
`SEGMENTS`."""


@compiled(
    void(
        reads(3), reads(2, int64), reads(2), reads(1), reads(2), reads(1, int64), reads(1, boolean), reads(2),
        writes(2),
    )
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
    """Counts the taxels, and the masked taxels, of p patches around each of m places.

    Args: poses: Poses `T_TL` (l, 4, 4) of all links. on: Indices (p, 2) in `poses` of the link of each patch,
        and of the link of its segment. limb: Numbers (p, 15) that describe the limb of each patch, see
        `limb_numbers`. posture: Generic angles [rad] of the part. positions: Positions (n, 3) [m] of the
        taxels of all patches, each in the link of its patch. begins: Indices (p + 1,) in `positions` at which
        the taxels of each patch begin; the last is n. masked: Mask (n,) of taxels that are not trusted.
        places: Table (5, m) with one column for each place: segment, three coordinates on the generic limb,
        and radius [limb lengths]. counts: Output (2, m), to which the numbers of taxels and of masked taxels
        are added.
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
