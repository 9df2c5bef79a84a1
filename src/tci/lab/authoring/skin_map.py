"""Cones through the taxels of a skin, and the unrolled map of the skin (x along the limb, theta around
it)."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.exceptions import RankWarning

from tci.errors import TciError
from tci.exports.cone import ConeFit, Freedom, fit_cone
from tci.messages.frames import Array

WIDEST = 3.0
"""Largest radius of a cone that is fitted to a skin, as a multiple of the size of this skin. Assumed: on a
wider cone, the skin is practically flat."""


def skin_cone(positions: Array, *, origin: Array, axis: Array, free: Freedom) -> ConeFit:
    """Fits a cone to taxels at `positions` (n, 3) [m] with `fit_cone`.

    Raises TciError if no cone fits: for an axis of length zero, too few taxels, or a flat skin.
    """
    if not np.linalg.norm(axis) > 1e-9:
        raise TciError(f"the axis {[float(value) for value in axis]} has no direction; give a vector (3,)")
    size = float(np.linalg.norm(np.ptp(positions, axis=0)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RankWarning)  # numpy warns about a flat skin, which is refused below
        fit = fit_cone(positions, origin=origin, axis=axis, free=free)
    if max(abs(fit.r1), abs(fit.r2)) > WIDEST * size:
        raise TciError(
            f"no cone: its radius would be {max(abs(fit.r1), abs(fit.r2)):.3g} m; the skin is flat"
        )
    return fit


def best_cone(positions: Array) -> ConeFit | None:
    """Returns the cone with the least root mean square error; None for a flat skin.

    Fits a cone three times, each time with another axis of the taxels' frame as the initial axis of the cone.
    Each fit may move and tilt this axis. Of the three results, the best is returned.
    """
    fits = []
    for axis in np.eye(3):
        try:
            fits.append(skin_cone(positions, origin=positions.mean(axis=0), axis=axis, free="axis"))
        except TciError:
            continue
    return min(fits, key=lambda fit: fit.rms, default=None)


def unroll(positions: Array, fit: ConeFit) -> tuple[Array, Array]:
    """Returns x (n,) [m], the place along a cone's axis from its proximal end, and the angle theta (n,) [rad]
    around the axis.

    Both coordinates depend on the cone's axis (eqs 3-4), but not on the cone's radii. Theta is from -pi to
    pi. Theta is zero in the direction of one axis of the frame: the axis that is most nearly perpendicular to
    the cone's axis.
    """
    relative = positions - fit.origin
    across = np.eye(3)[np.argmin(np.abs(fit.axis))]
    u = across - (across @ fit.axis) * fit.axis
    u /= np.linalg.norm(u)
    v = np.cross(fit.axis, u)
    return relative @ fit.axis, np.arctan2(relative @ v, relative @ u)


def flatten(positions: Array) -> tuple[Array, Array]:
    """Returns the coordinates (n,) and (n,) [m] of taxels along the two main directions of their skin."""
    relative = positions - positions.mean(axis=0)
    # The appended rows of zeros do not change the directions; with these rows, even one or two taxels have
    # three directions.
    longest = np.linalg.svd(np.vstack([relative, np.zeros((3, 3))]), full_matrices=False)[2]
    return relative @ longest[0], relative @ longest[1]
