"""The weighted force of a contact (eq. 7), in a compiled loop."""

from __future__ import annotations

import numpy as np
from numba import float64

from tci.compiled import compiled, inlined, views
from tci.frames import Array
from tci.robot.limb import RHO


@inlined
def limb_point(theta: float) -> tuple[float, float]:
    """Returns the coordinates y and z [limb lengths] of the point at the angle `theta` [rad] on the generic
    limb (eq. 6); see `generic_limb_point`."""
    return RHO * np.sin(theta), RHO * np.cos(theta)


@compiled(float64(float64, float64, views(1), views(1), views(1), float64))
def mean_force(
    u: float, theta: float, taxel_u: Array, taxel_theta: Array, forces: Array, radius: float
) -> float:
    """Returns the weighted force F-bar [N] of eq. 7; see `tci.skin.contacts.weighted_force`."""
    total, weights = 0.0, 0.0
    y, z = limb_point(theta)
    for i in range(len(forces)):
        taxel_y, taxel_z = limb_point(taxel_theta[i])
        dy, dz, dx = taxel_y - y, taxel_z - z, taxel_u[i] - u
        weight = 2.0 * radius - np.sqrt(dx * dx + dy * dy + dz * dz)
        if weight > 0.0:
            total += weight * forces[i]
            weights += weight
    return total / weights if weights > 0.0 else 0.0
