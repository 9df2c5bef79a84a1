"""The fill factor of a skin: the fraction of the surface around a place that its taxels measure.

Taxels measure neither the gaps between modules nor the area beyond the end of a sleeve. So the force of a
touch is divided by the fill factor, averaged over an area as wide as the touch.
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
Assumed: from the sharpest touch that taxels at distances of 5 mm resolve, to the touch of a palm."""
REACH = 2.5
"""Distance [standard deviations] at which the Gaussians are cut off. Assumed: this leaves out 4 % of their
weight."""
SPARSE = 2
"""Number of neighbours within `NEIGHBOUR_DISTANCE` below which a taxel measures a single place (switches,
bumpers, load cells). The fill factor of such a taxel is 1. Isolated taxels have the same bound, see
`IsolatedSettings`."""
_CHUNK = 8192


def is_surface(surface: Surface) -> NDArray[np.bool_]:
    """Returns True for each taxel (n,) on a surface where the pressure of a touch decreases gradually: not on
    a sheet, and not for sparse taxels."""
    if is_sheet(surface.normals):
        return np.zeros(len(surface.positions), np.bool_)
    tree = cKDTree(surface.positions)
    neighbours = tree.query_ball_point(surface.positions, NEIGHBOUR_DISTANCE, return_length=True)
    return np.asarray(neighbours > SPARSE)  # each counts itself


def fill_factors(surface: Surface) -> Array:
    """Returns the fill factor (n, WIDTHS) around each taxel of a patch. It is 1 at places without gaps
    nearby.

    On a sheet (a palm, a sole, a cap) the fill factor is 1: the part of the body ends at the edge of the
    sheet, and a rigid plate passes the load to the taxels. Taxels on the other side of a thin limb are not
    included, and distances are those along the arc between two taxels. A taxel has the weight of a Gaussian
    with the second moment of a disc of the taxel's area.
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
