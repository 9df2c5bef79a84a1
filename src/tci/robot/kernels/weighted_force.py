"""Compiled loop for the force of a contact as a weighted mean over its taxels (eq. 7 of the paper)."""

from __future__ import annotations

import numpy as np
from numba import float64

from tci.messages.frames import Array
from tci.robot.limb import RHO
from tci.support.compiled import compiled, inlined, views


@inlined
def limb_point(theta: float) -> tuple[float, float]:
    """Returns the coordinates y and z [limb lengths] of the point at the angle `theta` [rad] on the generic
    limb, a cylinder of length 1 (eq. 6). `theta` is 0 on the flexor side and pi/2 on the lateral side."""
    return RHO * np.sin(theta), RHO * np.cos(theta)


@compiled(float64(float64, float64, views(1), views(1), views(1), float64))
def mean_force(
    u: float, theta: float, taxel_u: Array, taxel_theta: Array, forces: Array, radius: float
) -> float:
    """Returns the weighted force F-bar [N] of a contact (eq. 7): the mean of the taxels' `forces` (k,) [N],
    with larger weights for taxels near the contact's centre. `u` and `theta` [rad] are the place of the
    centre on the generic limb, `taxel_u` (k,) and `taxel_theta` (k,) [rad] those of the taxels. `radius`
    [limb lengths] is the radius of the receptive field."""
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
