"""Rest values and noise of a patch, computed with NumPy. The kernel that updates them must give equal
results."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.skin.baseline import Baseline, near
from tci.skin.kernels.baseline import NOISE_GAIN, Window


class NumpyBaseline(Baseline):
    """Estimator of rest values that processes its windows with NumPy."""

    def update(self, window: Window, healthy: NDArray[np.bool_]) -> None:
        """Updates rest values and noise from a window. Uses only the `healthy` taxels (n,)."""
        s = self.settings
        fluctuating = window.changes >= s.fluctuating
        noise = np.where(fluctuating, window.second_difference / NOISE_GAIN, 0.0)
        initialised, rested, before, followed = self._estimates[3:]
        frozen = (window.changes == 0.0) & initialised & (self.noise >= s.lively)
        taught = healthy & ~frozen & ~before
        self.offset -= np.where(frozen & ~before, followed, 0.0)
        before[:] = frozen
        deviation = window.mean - self.offset
        level = s.threshold * np.maximum(np.maximum(self.noise, noise), self.typical_noise)
        low = window.peak < np.maximum(level, s.quiet)
        quiet = taught & low
        if self._afresh:
            self.offset[quiet] = window.mean[quiet]
            self._afresh = False
            deviation = window.mean - self.offset
        if np.count_nonzero(quiet) >= max(s.share * np.count_nonzero(healthy), 1.0):
            most = self._slew * window.elapsed
            drift = min(max(float(np.median(deviation[quiet])), -most), most)
            self.offset += drift
            deviation -= drift
        self._follow(window.elapsed, deviation, quiet, healthy & ~low, taught)
        # At the end of the sensor's range the noise is cut off, so an estimate from there may only increase
        # the noise.
        cut = window.mean - np.maximum(4.0 * self.noise, 1.0) < self._floor
        contributes = quiet & fluctuating & ~(cut & initialised & (noise < self.noise))
        share = np.where(initialised, 1.0 - np.exp(-window.elapsed / s.noise), 1.0)
        self.noise += np.where(contributes, share * (noise - self.noise), 0.0)
        initialised |= contributes
        rested |= quiet
        self.typical_noise = float(np.median(self.noise[rested] if rested.any() else self.noise))
        # A window contains too few frames to show that a taxel has less noise than its patch.
        self.threshold[:] = s.threshold * np.maximum(self.noise, self.typical_noise)

    def _follow(
        self, elapsed: float, deviation: Array, quiet: NDArray[np.bool_], loud: NDArray[np.bool_],
        taught: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        """Tracks the rest value of each taxel.

        At the weak edge of a touch the values look like noise, so neighbours of touched taxels are excluded.
        """
        s = self.settings
        own = quiet & ~near(loud & (deviation > 0.0), self._neighbours)
        below = loud & taught & (deviation < 0.0)
        share = np.where(own, 1.0 - np.exp(-elapsed / s.own), 0.0)
        share[below] = 1.0 - np.exp(-elapsed / s.release)
        self._estimates.followed[:] = share * deviation
        self.offset += self._estimates.followed
