"""Forces on three-axis taxels, which measure tangential force in addition to pressure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tci.messages import SkinFrame
from tci.messages.frames import Array, doubles
from tci.robot.description import Patch
from tci.skin.kernels.arrays import ActiveTaxels, Places
from tci.skin.layout import AXES, SkinLayout
from tci.skin.surfaces import Surface, tangents

SETTLE = 10.0
"""Time constant [s] with which the rest values of an untouched taxel are tracked. Assumed: this is slower
than a touch, and faster than a change of temperature."""
GAP = 1.0
"""A longer time between two frames counts as this time [s] when rest values are tracked. Assumed: without a
bound, the first frame after a long pause would replace the rest values from earlier frames."""


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
        """Returns the force (taxels, 3) [N] on each taxel, in the frame of the patch's link, from a raw frame
        (channels,).

        `pressure` (taxels,) [Pa] must come from conditioning of this frame. A taxel without pressure has no
        tangential force, and its rest values are updated. A value that is not finite, or outside the sensor's
        range, is replaced by the rest value.
        """
        sensor = self._sensor
        raw = doubles(values[self._channels])
        usable = (raw >= sensor.lowest) & (raw <= sensor.highest)  # the comparison is false for NaN
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


class ForceVectors:
    """Forces on the active taxels of a skin. Some patches of this skin have three-axis taxels."""

    def __init__(self, layout: SkinLayout) -> None:
        self._patches = layout.patches
        self._shears = {
            p: Shear(patch.description, patch.surface)
            for p, patch in enumerate(layout.patches)
            if patch.description.sensor.axes == AXES
        }
        self._vectors = {p: np.zeros((0, 3)) for p in self._shears}

    def step(self, which: Places, frames: Sequence[SkinFrame], active: ActiveTaxels) -> None:
        """Updates the forces of the patches with the indices `which` (k,) from one frame of each. `active`
        must have been computed from these `frames`."""
        if not self._shears:
            return
        for p, frame in zip(which.tolist(), frames, strict=True):
            if p in self._shears:
                own = slice(*active.begin[p : p + 2])
                pressure = np.zeros(len(self._patches[p].surface.areas))
                taxels = active.active[own]
                pressure[taxels] = active.pressure[own]
                self._vectors[p] = self._shears[p].force(frame.values, pressure, frame.stamp)[taxels]

    def latest(self, active: ActiveTaxels) -> Array | None:
        """Returns the force (k, 3) [N] on each active taxel, or None if no patch has three-axis taxels.

        If the sensor does not measure a direction, the force is along the inward normal.
        """
        if not self._shears:
            return None
        parts = []
        for p, patch in enumerate(self._patches):
            if p in self._shears:
                parts.append(self._vectors[p])
                continue
            own = slice(*active.begin[p : p + 2])
            taxels, surface = active.active[own], patch.surface
            force = active.pressure[own] * surface.areas[taxels]
            parts.append(-force[:, None] * surface.normals[taxels])
        return np.concatenate(parts)
