"""Measured properties of a robot's skin (rest, noise, response), in a file next to the robot's
description."""

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
    """Standard deviation [counts] of each taxel at rest, without contact."""
    response: tuple[tuple[float, float], ...] = ()
    """Points (counts away from rest, pressure [Pa]) of the response, rising from (0, 0). If empty, the
    response in the description is used."""
    gain: tuple[float, ...] = ()
    """Factor by which the pressure of each taxel is multiplied. If empty, all factors are 1."""
    report: dict[str, float | str]
    """Quality of the calibration: the loads used, the largest relative error, and other results."""

    def check(self, taxels: int) -> None:
        """Raises TciError in three cases: the number of taxels in this calibration differs from `taxels`, the
        response does not rise from (0, 0), or a gain is not above 0."""
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
    """Returns the path of the file with a robot's calibration, which is next to its description."""
    return description.with_suffix(SUFFIX)
