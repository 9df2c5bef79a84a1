"""What taxels read at rest: learnt while nothing touches them, and moved along with the patch's drift.

Warmth moves all taxels of a patch alike, a touch moves few of them: so the median of the quiet taxels is
drift, and counts for the touched ones too. A touched taxel's own rest value stays, however long it lasts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array


@dataclass(frozen=True, slots=True)
class BaselineSettings:
    """Time constants in seconds, so that the frame rate plays no part. All figures are ours."""

    drift_rate: float = 5e-4
    """Fastest common drift [share of the sensor's range per second]."""
    own: float = 30.0
    """Time constant [s] with which a quiet taxel's own rest value is followed."""
    release: float = 1.0
    """Time constant [s] for a taxel that reads below rest: pressure is never negative."""
    noise: float = 10.0
    """Time constant [s] of the noise estimate."""
    quiet: float = 2.0
    """Deviation [counts] below which a taxel counts as quiet, however small its noise."""
    threshold: float = 7.0
    """Deviations below this many standard deviations of the noise are no pressure."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"baseline: {field.name} {value}; valid: above 0 and finite")


class Baseline:
    """The rest values of one patch, as deviations [counts] from the description's."""

    def __init__(self, count: int, *, span: float, noise: float, settings: BaselineSettings) -> None:
        """`span` [counts] of the sensor's range; `noise` [counts] standard deviation to start with."""
        self.settings = settings
        self.offset = np.zeros(count)
        """Rest value (n,) [counts] beyond the description's, positive with pressure."""
        self.noise = np.full(count, noise)
        """Standard deviation (n,) [counts] of the noise."""
        self._middle = noise
        self._slew = settings.drift_rate * span
        self._last: Array | None = None

    @property
    def threshold(self) -> Array:
        """Deviation (n,) [counts] from which a taxel feels something.

        No taxel is taken to be quieter than the median of its patch: few frames are no proof of that.
        """
        threshold: Array = self.settings.threshold * np.maximum(self.noise, self._middle)
        return threshold

    def rezero(self) -> None:
        """What the taxels read now is rest."""
        if self._last is not None:
            self.offset = self._last.copy()

    def update(self, signal: Array, sound: NDArray[np.bool_], elapsed: float) -> Array:
        """Deviation (n,) [counts] from rest of `signal` (n,), after learning from it for `elapsed` [s].

        Only `sound` taxels (n,) teach anything.
        """
        s = self.settings
        deviation = signal - self.offset
        if elapsed > 0.0 and self._last is not None:
            quiet = sound & (np.abs(deviation) < np.maximum(self.threshold, s.quiet))
            if 2 * np.count_nonzero(quiet) >= np.count_nonzero(sound) > 0:
                drift = float(np.median(deviation[quiet]))
                self.offset += min(max(drift, -self._slew * elapsed), self._slew * elapsed)
            below = sound & ~quiet & (deviation < 0.0)
            rate = np.where(quiet, elapsed / s.own, np.where(below, elapsed / s.release, 0.0))
            self.offset += np.minimum(rate, 1.0) * deviation
            step = np.minimum(np.abs(signal - self._last), 4.0 * self.noise + s.quiet)
            # The mean difference of two readings with normal noise is 1.128 standard deviations.
            share = min(elapsed / s.noise, 1.0)
            self.noise += np.where(quiet, share * (step / 1.128 - self.noise), 0.0)
            self._middle = float(np.median(self.noise))
            deviation = signal - self.offset
        self._last = signal
        return deviation
