"""Three-axis taxels: tangential force in addition to pressure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array, doubles
from tci.robot.description import Patch
from tci.skin.layout import AXES
from tci.skin.surfaces import Surface, tangents

SETTLE = 10.0
"""Time constant [s] with which the rest values of an untouched taxel are tracked. Assumed: this is slower
than a touch, and faster than a change of temperature."""
GAP = 1.0
"""Upper bound [s] on the frame interval that is used to track rest values. Assumed: without a bound, the
first frame after a gap would replace the rest values that earlier frames gave."""


class Shear:
    """Converts the x and y values of one patch to tangential forces. Contains the rest values of x and y."""

    def __init__(self, patch: Patch, surface: Surface) -> None:
        self._sensor = patch.sensor
        self._areas = surface.areas
        self._channels = AXES * surface.channels[:, None] + np.arange(2)
        self._normals = surface.normals
        x = tangents(surface.normals) if surface.tangents is None else surface.tangents
        self._axes = np.stack([x, np.cross(surface.normals, x)], axis=1)
        self._rest = np.full((len(surface.areas), 2), patch.sensor.rest)
        self._frames = np.zeros((len(surface.areas), 1))
        self._stamp: float | None = None

    def force(self, values: NDArray[np.generic], pressure: Array, stamp: float) -> Array:
        """Returns the force (taxels, 3) [N] on each taxel, in the patch's link, from a raw frame (channels,).

        `pressure` (taxels,) [Pa] must come from conditioning of this frame. A taxel without pressure has no
        tangential force, and its rest values are updated. A value that is not finite, or outside the sensor's
        range, is replaced by the rest value.
        """
        sensor = self._sensor
        raw = doubles(values[self._channels])
        usable = (raw >= sensor.lowest) & (raw <= sensor.highest)  # NaN is not
        raw = np.where(usable, raw, self._rest)
        elapsed = GAP if self._stamp is None else min(max(stamp - self._stamp, 0.0), GAP)
        self._stamp = stamp
        touched = (pressure > 0.0)[:, None]
        # A running mean at first, then a low-pass filter.
        self._frames += ~touched
        share = np.maximum(1.0 - math.exp(-elapsed / SETTLE), 1.0 / np.maximum(self._frames, 1.0))
        self._rest += np.where(touched, 0.0, share * (raw - self._rest))
        stress = np.where(touched, (raw - self._rest) * sensor.shear_pascal_per_count, 0.0)
        along = np.einsum("na,nai->ni", stress, self._axes)
        force: Array = (along - pressure[:, None] * self._normals) * self._areas[:, None]
        return force
