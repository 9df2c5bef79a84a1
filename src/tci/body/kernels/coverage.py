"""Counts of trusted taxels around places of a generic limb."""

from __future__ import annotations

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, reads, writes
from tci.frames import Array
from tci.robot.kernels.limb import limb_pose
from tci.robot.limb import RHO

SEGMENT, X, Y, Z, RADIUS = range(5)
"""Rows of `places`: segment, point on the generic limb (3) and radius [limb lengths]."""
LENGTH, SIDE, PLACE = 12, 13, 14
"""Columns of `limb`, see `limb_numbers`."""


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
    """Counts the taxels of some patches around each of the `places` (5, m), and how many of them are `masked`
    (n,).

    The numbers are added to `counts` (2, m). `poses` (l, 4, 4) are `T_TL` of all links. `on` (p, 2) are the
    indices in `poses` of each patch's link and of its segment's link, `limb` (p, 15) the numbers of its limb.
    `posture` (n,) [rad] is that of the part. `positions` (n, 3) [m] are those of the taxels in their links;
    those of patch i begin at `begins[i]` (p + 1,).
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
