"""Conversion of a skin's raw values to pressure, and back."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tci.frames import Array
from tci.robot.description.base import Description


class Sensor(Description):
    """Conversion of raw values to pressure: (raw - rest) * pascal_per_count or a response curve, never below
    0."""

    rest: float
    """Raw value of an untouched taxel."""
    pascal_per_count: float
    """Response [Pa per count]; negative if raw values fall with pressure (as an iCub's skin)."""
    lowest: float
    """Smallest raw value that the sensor can send."""
    highest: float
    """Largest raw value that the sensor can send."""
    joints: bool = False
    """True if there are no taxels, and touches are felt through the torques of joints: `THROUGH_JOINTS`."""
    noise: float = 0.0
    """Initial standard deviation [counts] of values at rest; the actual one is estimated at run time."""
    response: tuple[tuple[float, float], ...] = ()
    """Points (counts away from rest, pressure [Pa]) of the response of a nonlinear sensor, both increasing
    from (0, 0). The response is linear between the points and beyond them. Empty: the response is
    `pascal_per_count`."""
    axes: Literal[1, 3] = 1
    """Values per taxel. 1: its pressure. 3: x and y, the stress along the skin, and z, outward; a frame then
    has three times as many values as the skin has channels."""
    shear: float | None = None
    """Linear response [Pa per count] of x and y; None: the absolute value of pascal_per_count."""

    @property
    def shear_pascal_per_count(self) -> float:
        """Response [Pa per count] of a three-axis taxel along the skin."""
        return abs(self.pascal_per_count) if self.shear is None else self.shear

    def pressure(self, counts: Array) -> Array:
        """Returns the pressure [Pa] of deviations from rest [counts], positive with pressure."""
        if not self.response:
            return counts * abs(self.pascal_per_count)
        return _along(counts, *np.array(self.response).T)

    def counts(self, pressure: Array) -> Array:
        """Returns the deviations from rest [counts] of pressures [Pa]: the inverse of `pressure`."""
        if not self.response:
            return pressure / abs(self.pascal_per_count)
        counts, pascal = np.array(self.response).T
        return _along(pressure, pascal, counts)


THROUGH_JOINTS = Sensor(rest=0.0, pascal_per_count=1.0, lowest=0.0, highest=1.0, joints=True)
"""Value for the sensor of a surface without taxels, which sends no frames."""


def _along(values: Array, nodes: Array, results: Array) -> Array:
    """Interpolates linearly between points (m,) and extrapolates beyond the last. Values below 0 give 0."""
    values = np.maximum(values, 0.0)
    slope = (results[-1] - results[-2]) / (nodes[-1] - nodes[-2])
    beyond = np.maximum(values - nodes[-1], 0.0) * slope
    result: Array = np.interp(values, nodes, results) + beyond
    return result
