"""Distribution of a force over taxels in plain NumPy. The compiled loop must give equal results."""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array
from tci.simulation.kernel import _SOFTNESS, _STEPS, _TOLERANCE, REACH


def spread(positions: Array, point: Array, normal: Array, sigma: float) -> Array:
    offsets = (positions - point) / sigma
    squared = np.einsum("ij,ij->i", offsets, offsets)
    distance = np.sqrt(squared)
    near = np.flatnonzero(distance <= distance.min() + REACH)
    logarithms = -0.5 * squared[near]
    shares = np.zeros(len(positions))
    shares[near] = _centred(logarithms, offsets[near] @ _tangents(normal))
    return shares


def _tangents(normal: Array) -> Array:
    """Returns two unit vectors perpendicular to `normal` (3,), as the columns of (3, 2)."""
    least = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first)])


def _centred(logarithms: Array, offsets: Array) -> Array:
    """Returns weights proportional to exp(logarithms + offsets . tilt), with the tilt for which the weighted
    mean offset is 0.

    Uses Newton's method on the convex function log(sum) + softness / 2 * tilt^2, whose gradient is the
    weighted mean offset except for the softness.
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
