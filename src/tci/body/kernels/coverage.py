"""Counts the taxels around places of a generic limb, and how many of these taxels are masked (not
trusted)."""

from __future__ import annotations

import numpy as np
from numba import boolean, from_dtype, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.kernels.limb import LIMB, limb_pose
from tci.robot.limb import RHO
from tci.support.compiled import compiled, reads, writes

PLACE = np.dtype(
    [(name, np.int64 if name == "segment" else np.float64) for name in ("segment", "x", "y", "z", "radius")]
)
"""A place on an arm: number of the segment (0 upper arm, 1 forearm), a point of the generic limb, and a
radius around it, both in limb lengths."""


@compiled(
    void(
        reads(3), reads(2, int64), reads(1, from_dtype(LIMB)), reads(1), reads(2), reads(1, int64),
        reads(1, boolean), reads(1, from_dtype(PLACE)), writes(2),
    )
)  # fmt: skip
def count_taxels(
    poses: Array,
    on: NDArray[np.int64],
    limbs: NDArray[np.void],
    posture: Array,
    positions: Array,
    begins: NDArray[np.int64],
    masked: NDArray[np.bool_],
    places: NDArray[np.void],
    counts: Array,
) -> None:
    """Counts the taxels of p patches on an arm around each of m places, and how many of these taxels are
    masked (not trusted).

    Args:
        poses: Poses (l, 4, 4) of l links in the torso frame.
        on: For each patch, the indices (p, 2) in `poses` of its link and of the link of its arm segment.
        limbs: For each patch, the LIMB of its arm segment.
        posture: Generic angles [rad] of the arm.
        positions: Positions (n, 3) [m] of the taxels, each in the link of its patch.
        begins: Index (p + 1,) in `positions` of the first taxel of each patch; the last is n.
        masked: Mask (n,) of masked taxels.
        places: The m places, of the type PLACE.
        counts: Output (2, m): the numbers of all taxels (row 0) and of masked taxels (row 1) are added to it.
    """
    for p in range(len(on)):
        limb = limbs[p]
        x_S, y_S, z_S = limb_pose(poses[on[p, 0]], poses[on[p, 1]], limb, posture)
        for t in range(begins[p], begins[p + 1]):
            a, b, c = positions[t, 0], positions[t, 1], positions[t, 2]
            x = x_S[0] * a + x_S[1] * b + x_S[2] * c + x_S[3]
            y = limb.side * (y_S[0] * a + y_S[1] * b + y_S[2] * c + y_S[3])
            u = -(z_S[0] * a + z_S[1] * b + z_S[2] * c + z_S[3]) / limb.length
            r = np.sqrt(x * x + y * y)
            sine, cosine = (y / r, x / r) if r > 0.0 else (0.0, 1.0)
            for m in range(len(places)):
                place = places[m]
                if place.segment != limb.segment:
                    continue
                dx, dy, dz = u - place.x, RHO * sine - place.y, RHO * cosine - place.z
                if dx * dx + dy * dy + dz * dz < place.radius * place.radius:
                    counts[0, m] += 1.0
                    counts[1, m] += 1.0 if masked[t] else 0.0
