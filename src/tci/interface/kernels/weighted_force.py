"""The weighted force of a contact (eq. 7), compiled."""

from __future__ import annotations

import numpy as np
from numba import float64, njit

from tci.frames import Array
from tci.interface.generic_limb import RHO
from tci.interface.kernels.arrays import views


@njit(cache=True, error_model="numpy")
def limb_distance(u: float, theta: float, u_other: float, theta_other: float) -> float:
    """See `generic_limb_distance`."""
    x = u - u_other
    y = RHO * (np.sin(theta) - np.sin(theta_other))
    z = RHO * (np.cos(theta) - np.cos(theta_other))
    return np.sqrt(x * x + y * y + z * z)  # type: ignore[no-any-return]


@njit(float64(float64, float64, views(1), views(1), views(1), float64), cache=True, error_model="numpy")
def mean_force(
    u: float, theta: float, taxel_u: Array, taxel_theta: Array, forces: Array, radius: float
) -> float:
    """See `tci.interface.contacts.weighted_force`."""
    total, weights = 0.0, 0.0
    for i in range(len(forces)):
        weight = 2.0 * radius - limb_distance(taxel_u[i], taxel_theta[i], u, theta)
        if weight > 0.0:
            total += weight * forces[i]
            weights += weight
    return total / weights if weights > 0.0 else 0.0
