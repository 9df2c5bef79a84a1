"""How one contact force spreads over the taxels around it.

The kernel is no model of an elastomer: the sum of the taxels' forces and their centre are right,
single taxels are not.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from tci.frames import Array
from tci.interface.kernels.arrays import reads, views, writes
from tci.interface.kernels.compiled import allocating, compiled, inlined

SIGMA = 3e-3
"""Width [m] of the Gaussian that the cover over the taxels makes of a point. Ours."""
_REACH = 6.0
"""Taxels farther from a contact than the nearest taxel and this many widths get nothing."""
_SOFTNESS = 0.02
"""What a tilt of the weights costs. With it a contact off the skin's edge has weights too. Ours."""
_STEPS = 30
_TOLERANCE = 1e-9


def width(areas: Array) -> float:
    """Width [m] of the kernel for taxels of `areas` (n,) [m2]: the cover's, and a taxel's own extent.

    A square of that area has a variance of area / 12 along each side, and variances add.
    """
    return float(np.sqrt(SIGMA**2 + np.mean(areas) / 12.0))


def spread(positions: Array, point: Array, normal: Array, sigma: float) -> Array:
    """Shares (n,) of a force at `point` (3,) [m] that taxels at `positions` (n, 3) [m] feel.

    They are at least 0, their sum is 1, and the taxels' mean, weighted by them, lies at `point` as
    seen along `normal` (3,), to 0.1 mm where taxels surround it; beside the skin's edge it lies there.
    Weights that have these properties and are nearest to a Gaussian's of width `sigma` [m], in the
    sense of entropy, are the local maximum-entropy ones: exp(lambda . x - x^2 / 2 sigma^2), with one
    tilt lambda for all taxels (Arroyo and Ortiz 2006, doi:10.1002/nme.1534).
    """
    shares = np.empty(len(positions))
    _spread(np.ascontiguousarray(positions), point, normal, sigma, shares)
    return shares


@allocating
def _tangents(normal: Array) -> Array:
    """Two unit vectors, the rows of (2, 3), across `normal` (3,)."""
    least = np.zeros(3)
    least[np.argmin(np.abs(normal))] = 1.0
    across = np.empty((2, 3))
    across[0] = np.cross(normal, least)
    across[0] /= np.sqrt(np.sum(across[0] ** 2))
    across[1] = np.cross(normal, across[0])
    return across


@inlined
def _potential(tilt: Array, logarithms: Array, offsets: Array, weights: Array) -> float:
    """Write the weights (k,) of a tilt (2,); the logarithm of their sum, and what the tilt costs."""
    top = -np.inf
    for i in range(len(weights)):
        weights[i] = logarithms[i] + offsets[0, i] * tilt[0] + offsets[1, i] * tilt[1]
        top = max(top, weights[i])
    total = 0.0
    for i in range(len(weights)):
        weights[i] = np.exp(weights[i] - top)
        total += weights[i]
    for i in range(len(weights)):
        weights[i] /= total
    return top + np.log(total) + 0.5 * _SOFTNESS * (tilt[0] ** 2 + tilt[1] ** 2)  # type: ignore[no-any-return]


@allocating
def _centre(logarithms: Array, offsets: Array, weights: Array) -> None:
    """Write weights (k,) proportional to exp(logarithms + offsets . tilt), with the tilt that centres them.

    Newton's method on the convex function log(sum) + softness / 2 * tilt^2, whose gradient is the
    weighted mean offset but for the softness.
    """
    tilt, trial, trial_weights = np.zeros(2), np.zeros(2), np.empty(len(weights))
    value = _potential(tilt, logarithms, offsets, weights)
    for _ in range(_STEPS):
        x = y = xx = xy = yy = 0.0
        for i in range(len(weights)):
            a, b, w = offsets[0, i], offsets[1, i], weights[i]
            x += w * a
            y += w * b
            xx += w * a * a
            xy += w * a * b
            yy += w * b * b
        g, h = x + _SOFTNESS * tilt[0], y + _SOFTNESS * tilt[1]
        if g * g + h * h < _TOLERANCE**2:
            break
        xx, xy, yy = xx - x * x + _SOFTNESS, xy - x * y, yy - y * y + _SOFTNESS
        determinant = xx * yy - xy * xy
        u, v = (xy * h - yy * g) / determinant, (xy * g - xx * h) / determinant
        slope = g * u + h * v
        size, better = 1.0, False
        while size > 1e-6 and not better:
            trial[0], trial[1] = tilt[0] + size * u, tilt[1] + size * v
            trial_value = _potential(trial, logarithms, offsets, trial_weights)
            better = trial_value <= value + 1e-4 * size * slope
            size /= 2.0
        if not better:
            break
        tilt[:], value = trial, trial_value
        weights[:] = trial_weights


@allocating
def spread_into(positions: Array, point: Array, normal: Array, sigma: float, shares: Array) -> int:
    """Write `spread`; how many taxels feel anything."""
    n = len(positions)
    least = np.inf
    for i in range(n):
        x, y, z = positions[i, 0] - point[0], positions[i, 1] - point[1], positions[i, 2] - point[2]
        shares[i] = (x * x + y * y + z * z) / (sigma * sigma)
        least = min(least, shares[i])
    limit = (np.sqrt(least) + _REACH) ** 2
    near = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        if shares[i] <= limit:
            near[count] = i
            count += 1
        else:
            shares[i] = 0.0
    across = _tangents(normal)
    logarithms, offsets, weights = np.empty(count), np.empty((2, count)), np.empty(count)
    for k in range(count):
        i = near[k]
        logarithms[k] = -0.5 * shares[i]
        for axis in range(2):
            x, y, z = positions[i, 0] - point[0], positions[i, 1] - point[1], positions[i, 2] - point[2]
            offsets[axis, k] = (x * across[axis, 0] + y * across[axis, 1] + z * across[axis, 2]) / sigma
    _centre(logarithms, offsets, weights)
    for k in range(count):
        shares[near[k]] = weights[k]
    return count


@compiled(int64(reads(2), views(1), views(1), float64, writes(1)))
def _spread(positions: Array, point: Array, normal: Array, sigma: float, shares: Array) -> int:
    return spread_into(positions, point, normal, sigma, shares)  # type: ignore[no-any-return]
