"""How one contact force spreads over the taxels around it.

The kernel is no model of an elastomer: the sum of the taxels' forces and their centre are right,
single taxels are not.
"""

from __future__ import annotations

import numpy as np

from tci.frames import Array

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
    offsets = (positions - point) / sigma
    squared = np.einsum("ij,ij->i", offsets, offsets)
    distance = np.sqrt(squared)
    near = np.flatnonzero(distance <= distance.min() + _REACH)
    logarithms = -0.5 * squared[near]
    shares = np.zeros(len(positions))
    shares[near] = _centred(logarithms, offsets[near] @ _tangents(normal))
    return shares


def _tangents(normal: Array) -> Array:
    """Two unit vectors, the columns of (3, 2), across `normal` (3,)."""
    least = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first)])


def _centred(logarithms: Array, offsets: Array) -> Array:
    """Weights proportional to exp(logarithms + offsets . tilt), with the tilt that centres them at 0.

    Newton's method on the convex function log(sum) + softness / 2 * tilt^2, whose gradient is the
    weighted mean offset but for the softness.
    """
    tilt = np.zeros(2)
    value, weights = _potential(tilt, logarithms, offsets)
    for _ in range(_STEPS):
        mean = weights @ offsets
        gradient = mean + _SOFTNESS * tilt
        if gradient @ gradient < _TOLERANCE**2:
            break
        covariance = (offsets * weights[:, None]).T @ offsets - np.outer(mean, mean)
        direction = np.linalg.solve(covariance + _SOFTNESS * np.eye(2), -gradient)
        slope = gradient @ direction
        size = 1.0
        while size > 1e-6:
            trial = tilt + size * direction
            trial_value, trial_weights = _potential(trial, logarithms, offsets)
            if trial_value <= value + 1e-4 * size * slope:
                break
            size /= 2.0
        else:
            break
        tilt, value, weights = trial, trial_value, trial_weights
    return weights


def _potential(tilt: Array, logarithms: Array, offsets: Array) -> tuple[float, Array]:
    exponents = logarithms + offsets @ tilt
    top = exponents.max()
    powers = np.exp(exponents - top)
    total = powers.sum()
    return float(top + np.log(total) + 0.5 * _SOFTNESS * tilt @ tilt), powers / total
