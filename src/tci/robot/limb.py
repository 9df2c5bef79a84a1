"""The generic limb: one cylinder for all robots, on which receptive fields are defined (eqs 4, 6).

A place (u, theta) on a limb of any robot is a point on a cylinder of length 1 and one standard radius. So one
file of fields is valid for limbs of different size and shape. On a thin limb, a field covers the same angle
around the limb as on a thick limb.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tci.messages.frames import Array

RHO = 0.3
"""Standard radius of the generic limb, as a fraction of its length. Assumed: between the fractions of an
iCub's forearm (0.27) and a NAO's forearm (0.35)."""


def generic_limb_point(u: ArrayLike, theta: ArrayLike) -> Array:
    """Returns the points (..., 3) <u, RHO sin(theta), RHO cos(theta)> of the generic limb (eq. 6), in limb
    lengths.

    `u` (...) is 0 at the proximal joint and 1 at the distal joint. `theta` (...) [rad] is 0 on the flexor
    side, +pi/2 lateral, pi on the extensor side and -pi/2 medial.
    """
    u, theta = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(theta, dtype=float))
    return np.stack([u, RHO * np.sin(theta), RHO * np.cos(theta)], axis=-1)


def generic_limb_distance(
    u: ArrayLike, theta: ArrayLike, u_other: ArrayLike, theta_other: ArrayLike
) -> Array:
    """Returns the Euclidean distances (...) between places on the generic limb (eq. 6), in limb lengths.

    Angles need no unwrapping, because theta and theta + 2 pi give equal points.
    """
    offset = generic_limb_point(u, theta) - generic_limb_point(u_other, theta_other)
    return np.asarray(np.linalg.norm(offset, axis=-1))
