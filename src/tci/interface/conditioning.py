"""From a raw frame of a patch to the pressure on its taxels.

Each robot's sensor has its own numbers: rest, resolution and sign come from the description, so
that above this module all skins speak pascal (§3.2: readings are normalised in layer L3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.frames import Array
from tci.model.description import Patch


class Conditioner:
    """Turns the raw frames of one patch into pressures.

    One lives as long as the patch's link is open: what is learnt about its taxels belongs here.
    """

    def __init__(self, patch: Patch, channels: NDArray[np.intp]) -> None:
        """`channels` (taxels,) are the places of the taxels in the raw frame."""
        self.patch = patch
        self.channels = channels
        self.dropped = 0
        """Values dropped until now: not finite, or none that the sensor can send."""

    def pressure(self, values: NDArray[np.generic]) -> Array:
        """Pressure (taxels,) [Pa] of a raw frame (channels,): never negative, always finite.

        A value that is not finite, or that the sensor can't send, counts as rest. Raises FrameError
        for another number of values, or for values that are no real numbers.
        """
        values = np.asarray(values)
        self._check(values)
        sensor = self.patch.sensor
        # Sensors send small and unsigned numbers; their differences need room.
        raw = values[self.channels].astype(np.float64)
        good = (raw >= sensor.lowest) & (raw <= sensor.highest)
        if not good.all():
            self.dropped += int(good.size - np.count_nonzero(good))
            raw[~good] = sensor.rest
        raw -= sensor.rest
        raw *= sensor.pascal_per_count
        return np.maximum(raw, 0.0, out=raw)

    def _check(self, values: NDArray[np.generic]) -> None:
        name, expected = self.patch.name, (self.patch.channels,)
        if values.shape != expected:
            raise FrameError(
                f"{name}: frame of shape {values.shape}, expected {expected}, one value per channel"
            )
        if values.dtype.kind not in "uif":
            raise FrameError(
                f"{name}: frame of type {values.dtype}, expected integers or floating point numbers"
            )
