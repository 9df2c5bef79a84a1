"""The fill factor of a skin: the fraction of the surface around a place that its taxels measure.

In the gaps between modules nothing is measured, nor beyond the end of a sleeve. The forces on the taxels of a
touch are therefore divided by the fill factor, averaged over an area as wide as the touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tci.frames import Array
from tci.skin.surfaces import NEIGHBOUR_DISTANCE, Surface
from tci.skin.triangulation import is_sheet

WIDTHS = 2e-3 * 2.0 ** np.arange(4)
"""Standard deviations [m] of the Gaussians by which the fill factor is averaged, each twice the one before.
Assumed: from the sharpest touch that a lattice of 5 mm resolves to a palm's."""
REACH = 2.5
"""Distance [standard deviations] at which the Gaussians end. Assumed: 4 % of them lies beyond."""
SPARSE = 2
"""Number of neighbours within `NEIGHBOUR_DISTANCE` below which a taxel measures a place, not a surface
(switches, bumpers, load cells): its fill factor is 1. That of isolated taxels, see `IsolatedSettings`."""
_CHUNK = 8192


def is_surface(surface: Surface) -> NDArray[np.bool_]:
    """Returns which taxels (n,) measure a surface on which a touch fades: not those of a sheet, nor sparse
    ones."""
    if is_sheet(surface.normals):
        return np.zeros(len(surface.positions), np.bool_)
    tree = cKDTree(surface.positions)
    neighbours = tree.query_ball_point(surface.positions, NEIGHBOUR_DISTANCE, return_length=True)
    return np.asarray(neighbours > SPARSE)  # each counts itself


def fill_factors(surface: Surface) -> Array:
    """Returns the fill factor (n, WIDTHS) around each taxel of a patch, 1 where the skin has no gap.

    That of a sheet (a palm, a sole, a cap) is 1: its body ends where it does, and its plate carries a load to
    the taxels. The other side of a thin limb does not count, and distances follow the arc between two taxels.
    A taxel counts as a Gaussian with the second moment of a disc of its area.
    """
    if is_sheet(surface.normals):
        return np.ones((len(surface.positions), len(WIDTHS)))
    tree, blur = cKDTree(surface.positions), surface.areas / (4.0 * np.pi)
    result = np.zeros((len(surface.positions), len(WIDTHS)))
    reach = REACH * np.sqrt(WIDTHS[-1] ** 2 + blur.max(initial=0.0))
    for first in range(0, len(result), _CHUNK):
        own = slice(first, first + _CHUNK)
        pairs = cKDTree(surface.positions[own]).sparse_distance_matrix(tree, reach, output_type="ndarray")
        one, other = pairs["i"], pairs["j"]
        cosine = np.einsum("ki,ki->k", surface.normals[own][one], surface.normals[other])
        facing = cosine > 0.0
        one, other, half = one[facing], other[facing], np.arccos(np.minimum(cosine[facing], 1.0)) / 2.0
        distance2 = (pairs["v"][facing] / np.sinc(half / np.pi)) ** 2
        for column, width in enumerate(WIDTHS):
            variance = width**2 + blur[other]
            near = distance2 < REACH**2 * variance
            variance = variance[near]
            weights = surface.areas[other[near]] * np.exp(-distance2[near] / (2.0 * variance)) / variance
            result[own, column] = np.bincount(one[near], weights, len(result[own]))
    result /= 2.0 * np.pi * (1.0 - np.exp(-(REACH**2) / 2.0))
    result[~is_surface(surface)] = 1.0
    return np.minimum(result, 1.0)
