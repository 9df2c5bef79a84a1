"""Conversion of a skin's raw values to pressure, and of pressure to raw values."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tci.messages.frames import Array
from tci.robot.description.base import Description


class Sensor(Description):
    """Conversion of raw values to pressure: (raw - rest) * pascal_per_count, or a response curve. The
    pressure is never below 0."""

    rest: float
    """Raw value of a taxel that is not touched."""
    pascal_per_count: float
    """Response [Pa per count]; negative if raw values decrease under pressure, as on an iCub."""
    lowest: float
    """Smallest raw value that the sensor can send."""
    highest: float
    """Largest raw value that the sensor can send."""
    joints: bool = False
    """True if the surface has no taxels, so that touches are detected from the torques of joints."""
    noise: float = 0.0
    """Initial standard deviation [counts] of raw values at rest. At run time, the deviation is estimated
    anew."""
    response: tuple[tuple[float, float], ...] = ()
    """Points (counts away from rest, pressure [Pa]) of a nonlinear response. Both values increase from (0,
    0). The response is linear between the points and beyond the last point. If empty, the response is linear
    with the slope `pascal_per_count`."""
    axes: Literal[1, 3] = 1
    """Number of values per taxel. With 1, the value is the pressure. With 3, the values are stresses: in x
    and y along the skin, and in the outward direction z. A frame then has three values for each channel in
    the description."""
    shear: float | None = None
    """Linear response [Pa per count] of the stresses along the skin, x and y. If None, the absolute value of
    `pascal_per_count` is used."""

    @property
    def switch(self) -> bool:
        """True if a taxel can only say pressed or not. The force that is computed from it is the force that
        closes it, whatever it is pressed with."""
        return not self.joints and self.highest - self.lowest <= 1.0

    @property
    def shear_pascal_per_count(self) -> float:
        """Response [Pa per count] of a three-axis taxel to stress along the skin."""
        return abs(self.pascal_per_count) if self.shear is None else self.shear

    def pressure(self, counts: Array) -> Array:
        """Returns the pressure [Pa] for `counts`, which are deviations from rest: positive under pressure."""
        if not self.response:
            return counts * abs(self.pascal_per_count)
        return along(counts, *np.array(self.response).T)

    def counts(self, pressure: Array) -> Array:
        """Returns the deviations from rest [counts] for pressures [Pa]. This is the inverse of `pressure`."""
        if not self.response:
            return pressure / abs(self.pascal_per_count)
        counts, pascal = np.array(self.response).T
        return along(pressure, pascal, counts)


THROUGH_JOINTS = Sensor(rest=0.0, pascal_per_count=1.0, lowest=0.0, highest=1.0, joints=True)
"""Sensor of a surface without taxels. Such a surface sends no frames: joint torques show its touches."""


def along(values: Array, nodes: Array, results: Array) -> Array:
    """Returns the value of a response curve at each of `values`. The curve is linear between the points
    (`nodes[i]`, `results[i]`) and beyond the last point. For values below 0 the result is 0."""
    values = np.maximum(values, 0.0)
    slope = (results[-1] - results[-2]) / (nodes[-1] - nodes[-2])
    beyond = np.maximum(values - nodes[-1], 0.0) * slope
    result: Array = np.interp(values, nodes, results) + beyond
    return result
