"""Points that measure along three axes, of which skin needs the one across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError

AXES = {"z": 1, "xyz": 3}
"""Values of each point: along the normal, or along x, y and z."""


def values_per_point(axes: str) -> int:
    """Raises DriverError for axes that there are not."""
    if axes not in AXES:
        raise DriverError(f"axes={axes}; valid: {', '.join(AXES)}")
    return AXES[axes]


def along(points: NDArray[np.generic], axes: str) -> NDArray[np.generic]:
    """Values of (n, 3) points, flat: (n,) or (3 n,)."""
    return points[:, 2] if axes == "z" else points.ravel()
