"""The fill factor of a skin: the fraction of the surface around a place that the taxels measure.

Taxels do not measure the gaps between modules or the area beyond the end of a sleeve. So the measured force
of a touch is divided by the fill factor, averaged over an area as wide as the touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.near_points import distances_within, number_within
from tci.skin.surfaces import NEIGHBOUR_DISTANCE, Surface
from tci.skin.triangulation import is_sheet

WIDTHS = 2e-3 * 2.0 ** np.arange(4)
"""Standard deviations [m] of the Gaussians over which the fill factor is averaged. Each of these widths is
twice the previous one. Assumed: they range from the sharpest touch that taxels at distances of 5 mm can
resolve to the touch of a palm."""
REACH = 2.5
"""Distance [standard deviations] beyond which the Gaussian weight of a taxel counts as zero. Assumed: the
error is small, since only 4 % of the volume under a two-dimensional Gaussian lies beyond this distance."""
SPARSE = 2
"""On a dense skin, each taxel has at least this many neighbours within `NEIGHBOUR_DISTANCE`. A taxel with
fewer neighbours measures a single place (switches, bumpers, load cells). The fill factor of such a taxel is
1."""
_CHUNK = 8192


def is_surface(surface: Surface) -> NDArray[np.bool_]:
    """Returns True for each taxel (n,) on a dense skin around a body part, where the pressure of a touch
    decreases gradually towards the edge of the touch.

    The result is False for taxels with fewer than two neighbours (`SPARSE`), and for all taxels of a sheet (a
    palm, a sole, a cap, a single taxel).
    """
    if is_sheet(surface.normals):
        return np.zeros(len(surface.positions), np.bool_)
    return number_within(surface.positions, NEIGHBOUR_DISTANCE) > SPARSE  # each counts itself


def fill_factors(surface: Surface) -> Array:
    """Returns the fill factor (n, 4) around each of a patch's n taxels. The columns are averages over areas
    of increasing width (`WIDTHS`).

    The factor is 1 at places without gaps nearby. On a sheet (a palm, a sole, a cap) the fill factor is 1.
    The reasons: the body part ends at the edge of the sheet, and a rigid plate passes the load to the taxels.
    Taxels on the other side of a thin limb are left out. Distances are measured along the arc between two
    taxels. In an average, a taxel counts as a Gaussian with the second moment of a disc that has the taxel's
    area.
    """
    if is_sheet(surface.normals):
        return np.ones((len(surface.positions), len(WIDTHS)))
    positions, blur = surface.positions, surface.areas / (4.0 * np.pi)
    result = np.zeros((len(positions), len(WIDTHS)))
    reach = REACH * np.sqrt(WIDTHS[-1] ** 2 + blur.max(initial=0.0))
    for first in range(0, len(result), _CHUNK):
        own = slice(first, first + _CHUNK)
        one, other, distance = distances_within(positions[own], positions, reach)
        cosine = np.einsum("ki,ki->k", surface.normals[own][one], surface.normals[other])
        facing = cosine > 0.0
        one, other, half = one[facing], other[facing], np.arccos(np.minimum(cosine[facing], 1.0)) / 2.0
        distance2 = (distance[facing] / np.sinc(half / np.pi)) ** 2
        for column, width in enumerate(WIDTHS):
            variance = width**2 + blur[other]
            near = distance2 < REACH**2 * variance
            variance = variance[near]
            weights = surface.areas[other[near]] * np.exp(-distance2[near] / (2.0 * variance)) / variance
            result[own, column] = np.bincount(one[near], weights, len(result[own]))
    result /= 2.0 * np.pi * (1.0 - np.exp(-(REACH**2) / 2.0))
    result[~is_surface(surface)] = 1.0
    return np.minimum(result, 1.0)
