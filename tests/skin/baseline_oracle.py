"""Rest values and noise of a patch by NumPy, for the kernel that updates them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.skin.baseline import Baseline, near
from tci.skin.kernels.baseline import NOISE_GAIN, Window


class NumpyBaseline(Baseline):
    """A baseline whose windows are processed by NumPy."""

    def update(self, window: Window, healthy: NDArray[np.bool_]) -> None:
        """Updates rest values and noise from a window, by its `healthy` taxels (n,) only."""
        s = self.settings
        fluctuating = window.changes >= s.fluctuating
        noise = np.where(fluctuating, window.second_difference / NOISE_GAIN, 0.0)
        deviation = window.mean - self.offset
        level = np.maximum(s.threshold * np.maximum(self.noise, noise), s.quiet)
        quiet = healthy & (window.peak < level)
        if self._afresh:
            self.offset[quiet] = window.mean[quiet]
            self._afresh = False
            deviation = window.mean - self.offset
        if np.count_nonzero(quiet) >= max(s.share * np.count_nonzero(healthy), 1.0):
            most = self._slew * window.elapsed
            drift = min(max(float(np.median(deviation[quiet])), -most), most)
            self.offset += drift
            deviation -= drift
        self._follow(window.elapsed, deviation, quiet, healthy)
        # Noise is cut off at the end of the range: an estimate from there may only raise it.
        cut = window.mean - np.maximum(4.0 * self.noise, 1.0) < self._floor
        initialised, rested = self._estimates.initialised, self._estimates.rested
        contributes = quiet & fluctuating & ~(cut & initialised & (noise < self.noise))
        share = np.where(initialised, 1.0 - np.exp(-window.elapsed / s.noise), 1.0)
        self.noise += np.where(contributes, share * (noise - self.noise), 0.0)
        initialised |= contributes
        rested |= quiet
        self.typical_noise = float(np.median(self.noise[rested] if rested.any() else self.noise))
        # A window has too few frames to show that a taxel is quieter than its patch.
        self.threshold[:] = s.threshold * np.maximum(self.noise, self.typical_noise)

    def _follow(
        self, elapsed: float, deviation: Array, quiet: NDArray[np.bool_], healthy: NDArray[np.bool_]
    ) -> None:
        """Tracks each taxel's own rest value.

        The weak edge of a touch looks quiet, so neighbours of touched taxels are excluded.
        """
        s = self.settings
        touched = healthy & ~quiet & (deviation > 0.0)
        own = quiet & ~near(touched, self._neighbours)
        below = healthy & ~quiet & (deviation < 0.0)
        share = np.where(own, 1.0 - np.exp(-elapsed / s.own), 0.0)
        share[below] = 1.0 - np.exp(-elapsed / s.release)
        self.offset += share * deviation
