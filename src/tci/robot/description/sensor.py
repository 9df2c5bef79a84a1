"""How raw values of a skin become pressure, and back."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tci.frames import Array
from tci.robot.description.base import Description


class Sensor(Description):
    """How raw values become pressure: (raw - rest) * pascal_per_count, or by a response curve; at least 0."""

    rest: float
    """Raw value with nothing touching."""
    pascal_per_count: float
    """Response [Pa per count]; negative where raw falls with pressure (an iCub's skin)."""
    lowest: float
    """Smallest raw value that the sensor can send."""
    highest: float
    """Largest raw value that the sensor can send."""
    noise: float = 0.0
    """Standard deviation [counts] of its values at rest, to start with: the rest is learnt."""
    response: tuple[tuple[float, float], ...] = ()
    """Pairs of counts away from rest and pressure [Pa], both rising from 0, 0, for a sensor that is not
    linear; straight lines between them and beyond. Empty: pascal_per_count is all there is."""
    axes: Literal[1, 3] = 1
    """1: a raw value is a taxel's pressure. 3: each taxel sends x and y, the stress along the skin, and z,
    outward; a frame has three times as many values as the skin has channels."""
    shear: float | None = None
    """Response [Pa per count] of x and y, linear; None: the size of pascal_per_count."""

    @property
    def shear_pascal_per_count(self) -> float:
        """Response [Pa per count] of a three-axis taxel along the skin."""
        return abs(self.pascal_per_count) if self.shear is None else self.shear

    def pressure(self, counts: Array) -> Array:
        """Pressure [Pa] of deviations from rest [counts], positive with pressure."""
        if not self.response:
            return counts * abs(self.pascal_per_count)
        return _along(counts, *np.array(self.response).T)

    def counts(self, pressure: Array) -> Array:
        """Deviations from rest [counts] of pressures [Pa]: the inverse."""
        if not self.response:
            return pressure / abs(self.pascal_per_count)
        counts, pascal = np.array(self.response).T
        return _along(pressure, pascal, counts)


def _along(values: Array, nodes: Array, results: Array) -> Array:
    """Straight lines through points (m,), beyond the last too. Values below 0 are 0."""
    values = np.maximum(values, 0.0)
    slope = (results[-1] - results[-2]) / (nodes[-1] - nodes[-2])
    beyond = np.maximum(values - nodes[-1], 0.0) * slope
    result: Array = np.interp(values, nodes, results) + beyond
    return result
