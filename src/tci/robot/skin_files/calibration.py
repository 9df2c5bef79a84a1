"""Measured properties of a robot's skin (rest, noise, response), in a file next to its description."""

from __future__ import annotations

import math
from pathlib import Path

from tci.errors import TciError
from tci.robot.description import Description

SUFFIX = ".skin.json"


class PatchCalibration(Description):
    """Calibration of one patch."""

    rest: tuple[float, ...]
    """Raw value of each taxel without contact."""
    noise: tuple[float, ...]
    """Standard deviation [counts] of each taxel at rest."""
    response: tuple[tuple[float, float], ...] = ()
    """Points (counts away from rest, pressure [Pa]) rising from 0, 0; empty: the description's response."""
    gain: tuple[float, ...] = ()
    """Factor of each taxel's pressure; empty: 1 for all."""
    report: dict[str, float | str]
    """Quality of the calibration: loads, largest relative error, ..."""

    def check(self, taxels: int) -> None:
        """Raises TciError for another number of taxels, a response that does not rise from 0, 0, or a gain
        that is not above 0."""
        if not len(self.rest) == len(self.noise) == taxels:
            raise TciError(f"a calibration of {len(self.rest)} taxels; valid: {taxels}, as in the patch")
        pairs = list(zip(self.response, self.response[1:], strict=False))
        rising = all(low[0] < high[0] and low[1] < high[1] for low, high in pairs)
        if self.response and (len(self.response) < 2 or self.response[0] != (0.0, 0.0) or not rising):
            raise TciError("a calibration's response must have two points or more that rise from 0, 0")
        if self.gain and not (len(self.gain) == taxels and all(0.0 < one < math.inf for one in self.gain)):
            raise TciError(f"a calibration's gains must be {taxels}, one a taxel, above 0 and finite")


class SkinCalibration(Description):
    """Calibration of a robot's whole skin."""

    robot: str
    """Name of the robot."""
    date: str
    """Date of the measurement, ISO 8601."""
    patches: dict[str, PatchCalibration]
    """Calibrations of the patches, by name."""


def calibration_path(description: Path) -> Path:
    """Returns the path of a robot's calibration: next to its description."""
    return description.with_suffix(SUFFIX)
