"""Fault injectors for taxels, which change the data of the first patch of skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tci.lab.faults.injectors.injector import Injector
from tci.messages import SkinFrame
from tci.messages.frames import Array


class _Taxels(Injector):
    """Base class of faults that change raw values of the robot's first patch."""

    def frame(self, frame: SkinFrame) -> SkinFrame:
        if frame.patch != self.driver.robot.patches[0].name:
            return frame
        if frame.values.dtype.kind not in "uif":
            return frame  # another fault has already changed the frame
        values = frame.values.astype(float)
        sensor = self.driver.robot.patches[0].sensor
        pressed = sensor.lowest if sensor.pascal_per_count < 0.0 else sensor.highest
        return replace(frame, values=self.change(values, float(pressed), float(sensor.rest)))

    def change(self, values: Array, pressed: float, rest: float) -> NDArray[np.generic]:
        """Returns the faulty raw values (channels,) that replace `values` (channels,). `pressed` is the raw
        value at the hardest touch, `rest` the raw value without touch.
        """
        raise NotImplementedError


class StuckHigh(_Taxels):
    """One taxel that always reports the value of the hardest touch."""

    number = 1
    description = "one taxel of the first patch reports the hardest touch"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[0] = pressed
        return values


class StuckLow(_Taxels):
    """One taxel that never reports a touch."""

    number = 2
    description = "one taxel of the first patch reports rest"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[0] = rest
        return values


class DeadPatch(_Taxels):
    """A patch that reports zero for all taxels."""

    number = 3
    description = "the first patch reports zeros"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        return np.zeros_like(values)


class NaNTaxel(_Taxels):
    """A patch on which every tenth value is not a number."""

    number = 4
    description = "every tenth taxel of the first patch is not a number"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[::10] = np.nan
        return values


class Saturated(_Taxels):
    """Twelve channels that report the value at the upper end of the sensor's range."""

    number = 5
    description = "twelve neighbouring channels of the first patch are at the end of their range"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[:12] = pressed
        return values


class BaselineStep(_Taxels):
    """A sudden shift of all values of the first patch."""

    number = 7
    description = "all taxels of the first patch read a fifth of their range more than before"
    shows_after = 32.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        stepped: Array = values + 0.2 * (pressed - rest)
        return stepped


class WrongCount(_Taxels):
    """A frame with a wrong number of values."""

    number = 15
    description = "frames of the first patch lack their last value"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        return values[:-1]


class WrongType(_Taxels):
    """A frame with text instead of numbers."""

    number = 35
    description = "frames of the first patch hold text instead of numbers"

    def change(self, values: Array, pressed: float, rest: float) -> NDArray[np.generic]:
        return np.array(["touch"] * len(values))
