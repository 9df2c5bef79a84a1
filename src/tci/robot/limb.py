"""The generic limb: one cylinder for all robots, on which receptive fields are defined (eqs 4, 6).

A place (u, theta) of any robot's limb is a point of a cylinder of length 1 and of one standard radius. So one
file of fields is valid for limbs of different size and shape, and a field on a thin limb does not extend
around the limb.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tci.frames import Array

RHO = 0.3
"""Standard radius, in lengths of the limb. Assumed: between an iCub's forearm (0.27) and a NAO's (0.35)."""


def generic_limb_point(u: ArrayLike, theta: ArrayLike) -> Array:
    """Returns points (..., 3) <u, RHO sin(theta), RHO cos(theta)> [limb lengths] of the generic limb (eq. 6).

    `u` (...) is 0 at the proximal and 1 at the distal joint; `theta` (...) [rad] is 0 on the flexor side,
    +pi/2 lateral, pi extensor, -pi/2 medial.
    """
    u, theta = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(theta, dtype=float))
    return np.stack([u, RHO * np.sin(theta), RHO * np.cos(theta)], axis=-1)


def generic_limb_distance(
    u: ArrayLike, theta: ArrayLike, u_other: ArrayLike, theta_other: ArrayLike
) -> Array:
    """Returns the Euclidean distances (...) [limb lengths] between places of the generic limb (eq. 6).

    Angles need no unwrapping, since theta and theta + 2 pi are one place.
    """
    offset = generic_limb_point(u, theta) - generic_limb_point(u_other, theta_other)
    return np.asarray(np.linalg.norm(offset, axis=-1))
