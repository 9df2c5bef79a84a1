"""What taxels read at rest: learnt while nothing touches them, and moved along with the patch's drift.

Warmth moves all taxels of a patch alike, a touch moves few of them: so the median of the quiet taxels is
drift, and counts for the touched ones too. A touched taxel's own rest value stays, however long it lasts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import TciError
from tci.frames import Array

NOISE_GAIN = np.sqrt(6.0) * np.sqrt(2.0 / np.pi)
"""Mean size of the second difference of normal noise, in standard deviations of the noise."""


@dataclass(frozen=True, slots=True)
class BaselineSettings:
    """Time constants in seconds, so that the frame rate plays no part. All figures are ours."""

    window: float = 1.0
    """Time [s] over which frames are averaged before something is learnt from them."""
    frames: int = 50
    """And at least so many frames, or single readings of a touch would look like noise."""
    drift_rate: float = 5e-4
    """Fastest common drift [share of the sensor's range per second]."""
    own: float = 30.0
    """Time constant [s] with which a quiet taxel's own rest value is followed."""
    release: float = 1.0
    """Time constant [s] for a taxel that reads below rest: pressure is never negative."""
    noise: float = 20.0
    """Time constant [s] of the noise estimate."""
    quiet: float = 2.0
    """Deviation [counts] below which a taxel counts as quiet, however small its noise."""
    threshold: float = 7.0
    """Deviations below this many standard deviations of the noise are no pressure."""
    fluctuating: float = 0.2
    """Share of the frames of a window that must differ from the one before to be called noise."""
    share: float = 0.25
    """Share of the healthy taxels that must be quiet before their median counts as drift."""

    step: float = 30.0
    """How long [s] nearly all taxels must read pressure to be called a step of the sensor, and rest; but of a
    sole, which may carry weight for ever."""
    step_share: float = 0.9
    """How many of the healthy taxels are nearly all."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"baseline: {field.name} {value}; valid: above 0 and finite")


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """What a patch read for some time, per taxel."""

    elapsed: float
    """Its length [s]."""
    mean: Array
    """Mean signal (n,) [counts]."""
    peak: Array
    """Largest deviation (n,) [counts] from the rest value."""
    second_difference: Array
    """Mean size (n,) [counts] of second differences: slow changes, a touch among them, leave it alone."""
    changes: Array
    """Share (n,) of the frames that differ from the one before."""


class Baseline:
    """The rest values of one patch, as deviations [counts] from the description's."""

    def __init__(
        self,
        count: int,
        *,
        span: float,
        floor: float = -np.inf,
        noise: float,
        neighbours: NDArray[np.intp],
        settings: BaselineSettings,
    ) -> None:
        """`span` [counts] of the sensor's range, `floor` the lowest signal that it can show; `noise` [counts]
        standard deviation to start with; `neighbours` (m, 2) pairs of taxels that touch."""
        self.settings = settings
        self.offset = np.zeros(count)
        """Rest value (n,) [counts] beyond the description's, positive with pressure."""
        self.noise = np.full(count, noise)
        """Standard deviation (n,) [counts] of the noise."""
        self.threshold = settings.threshold * self.noise
        """Deviation (n,) [counts] from which a taxel feels something."""
        self._floor = floor
        self._slew = settings.drift_rate * span
        self._neighbours = neighbours
        self._initialised = np.zeros(count, dtype=bool)
        self._afresh = False

    def start(self, offset: Array, noise: ArrayLike) -> None:
        """Begin with what is known: rest values (n,) and standard deviations (n,) [counts]."""
        self.offset[:] = offset
        self.noise[:] = noise
        self.threshold[:] = self.settings.threshold * self.noise
        self._initialised[:] = True

    def rezero(self, signal: Array) -> None:
        """`signal` (n,) [counts] is rest; the next window makes it exact."""
        self.offset[:] = signal
        self._afresh = True

    def update(self, window: Window, healthy: NDArray[np.bool_]) -> None:
        """Only `healthy` taxels (n,) teach anything."""
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
            drift = min(max(median(deviation[quiet]), -most), most)
            self.offset += drift
            deviation -= drift
        self._follow(window.elapsed, deviation, quiet, healthy)
        # At the end of the range noise is cut off: there it may be found larger, never smaller.
        cut = window.mean - np.maximum(4.0 * self.noise, 1.0) < self._floor
        contributes = quiet & fluctuating & ~(cut & self._initialised & (noise < self.noise))
        share = np.where(self._initialised, 1.0 - np.exp(-window.elapsed / s.noise), 1.0)
        self.noise += np.where(contributes, share * (noise - self.noise), 0.0)
        self._initialised |= contributes
        # Few frames are no proof that a taxel is quieter than its patch.
        self.threshold[:] = s.threshold * np.maximum(self.noise, median(self.noise))

    def _follow(
        self, elapsed: float, deviation: Array, quiet: NDArray[np.bool_], healthy: NDArray[np.bool_]
    ) -> None:
        """Each taxel's own rest value. A touch's weak edge looks quiet, so its neighbours wait."""
        s = self.settings
        touched = healthy & ~quiet & (deviation > 0.0)
        own = quiet & ~near(touched, self._neighbours)
        below = healthy & ~quiet & (deviation < 0.0)
        share = np.where(own, 1.0 - np.exp(-elapsed / s.own), 0.0)
        share[below] = 1.0 - np.exp(-elapsed / s.release)
        self.offset += share * deviation


def median(values: Array) -> float:
    """Median of finite numbers (n,), n > 0: NumPy's own takes six times as long for a patch."""
    upper, odd = divmod(values.size, 2)
    parted = np.partition(values, upper if odd else (upper - 1, upper))
    return float(parted[upper] if odd else 0.5 * (parted[upper - 1] + parted[upper]))


def near(touched: NDArray[np.bool_], neighbours: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which taxels (n,) have a touched neighbour; `neighbours` (m, 2) are pairs."""
    result = np.zeros(touched.size, dtype=bool)
    if touched.any():
        one, other = neighbours.T
        result[one[touched[other]]] = True
        result[other[touched[one]]] = True
    return result
