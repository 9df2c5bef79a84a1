"""Estimates of each taxel's rest value and noise, window by window.

A change of temperature shifts all taxels of a patch by similar amounts, while a touch changes only a few
taxels. So the median deviation of the quiet taxels is taken as the drift of the patch. This drift is added to
the rest values of all taxels, also of touched ones. Apart from this, the rest value of a touched taxel stays
constant during a touch of any length.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import exp

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import TciError
from tci.messages.frames import Array
from tci.skin.kernels.baseline import ROOM, BaselineArrays, Window, WindowSettings, update_baseline


@dataclass(frozen=True, slots=True)
class BaselineSettings:
    """Settings of the baseline. Times are in seconds, so results do not depend on the frame rate.

    All figures are assumed, since drift and noise differ from sensor to sensor. With shorter time constants
    the rest values follow drift faster, but a slow touch is also mistaken for drift sooner.
    """

    window: float = 1.0
    """Least length [s] of an estimation window. With a longer window, the rest values follow drift later.
    With a shorter window, the estimate of noise is less exact."""
    frames: int = 50
    """Least number of frames in an estimation window. With fewer frames, single readings of a touch would
    look like noise."""
    drift_rate: float = 5e-4
    """Upper bound on the drift that all taxels of a patch have in common [fraction of the sensor's range per
    second]. A faster change counts as a touch."""
    own: float = 30.0
    """Time constant [s] with which the rest value of a quiet taxel follows the taxel's own deviation, after
    the drift of the whole patch was subtracted."""
    release: float = 1.0
    """Time constant [s] with which the rest value is tracked if the taxel reads less than this rest value.
    The time is short, since a reading below rest can't be a touch: pressure is never negative."""
    noise: float = 20.0
    """Time constant [s] of the noise estimate."""
    quiet: float = 2.0
    """Deviation [counts] below which a taxel always counts as quiet, also if this deviation is large compared
    with the taxel's noise."""
    threshold: float = 7.0
    """A taxel is active if its deviation exceeds this many standard deviations of its noise."""
    fluctuating: float = 0.2
    """A taxel counts as noisy if its value differs from its previous value in at least this fraction of
    frames."""
    lively: float = 0.4
    """A taxel with at least this noise [counts] counts as frozen if its value stays constant for a window.
    The shortest window has 50 values. In about one of 1e5 such windows, a healthy taxel with this noise sends
    equal values by chance."""
    share: float = 0.25
    """Least fraction of the healthy taxels that must be quiet before their median counts as drift."""

    step: float = 30.0
    """Time [s] after which pressure on nearly all taxels counts as a step of the baseline. The present
    values then become the rest values. Soles are excepted, since they may carry weight for any time."""
    step_share: float = 0.9
    """Pressure on at least this fraction of the healthy taxels, for the time `step`, counts as a step of the
    baseline."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"baseline: {field.name} {value}; valid: above 0 and finite")


class Baseline:
    """The rest values of one patch, as deviations [counts] from the rest value in the description."""

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
        """Starts with the rest value in the description for every taxel.

        `span` [counts] is the sensor's range. `floor` [counts] is the lowest deviation from the rest value in
        the description that the sensor can report. `noise` [counts] is the initial standard deviation.
        `neighbours` (m, 2) are pairs of neighbouring taxels.
        """
        self.settings = settings
        self.offset = np.zeros(count)
        """Rest value (n,) [counts] relative to the rest value in the description. If pressure decreases the
        sensor's raw values, the sign of this number is reversed."""
        self.noise = np.full(count, noise)
        """Standard deviation (n,) [counts] of the noise."""
        self.threshold = settings.threshold * self.noise
        """Deviation (n,) [counts] above which a taxel is active."""
        self.typical_noise = float(noise)
        """Median standard deviation [counts] of the taxels that have been at rest. If no taxel has been at
        rest: the median of all taxels.

        Taxels that were loaded from the start, for example by the robot's weight, are left out, because
        their noise is unknown."""
        self._floor = floor
        self._slew = settings.drift_rate * span
        self._neighbours = np.ascontiguousarray(neighbours, np.int64)
        self.rested = np.zeros(count, dtype=bool)
        """True (n,) for each taxel that has been at rest in at least one estimation window."""
        initialised = np.zeros(count, dtype=bool)
        self.frozen = np.zeros(count, dtype=bool)
        """True (n,) for each taxel that fluctuates at rest (measured noise of at least `settings.lively`),
        but whose value was constant in the latest window. The rest value and noise of such a taxel are not
        updated, also not in the first window in which its value changes again."""
        self._estimates = BaselineArrays(
            self.offset, self.noise, self.threshold, initialised, self.rested, self.frozen, np.zeros(count)
        )
        self._room = np.zeros((ROOM, count))
        self._afresh = False

    def start(self, offset: Array, noise: ArrayLike) -> None:
        """Sets the rest values (n,) and standard deviations (n,) [counts] to those of an earlier
        measurement."""
        self.offset[:] = offset
        self.noise[:] = noise
        self.threshold[:] = self.settings.threshold * self.noise
        self._estimates.initialised[:] = self.rested[:] = True
        self.typical_noise = float(np.median(self.noise))

    def rezero(self, signal: Array) -> None:
        """Makes `signal` (n,) [counts] the new rest values.

        The next estimation window refines these values.
        """
        self.offset[:] = signal
        self._estimates.followed[:] = 0.0
        self._afresh = True

    def update(self, window: Window, healthy: NDArray[np.bool_]) -> None:
        """Updates rest values and noise of the `healthy` taxels (n,) from one estimation window."""
        s, elapsed = self.settings, window.elapsed
        own, release, noise = (1.0 - exp(-elapsed / constant) for constant in (s.own, s.release, s.noise))
        settings = WindowSettings(
            float(s.threshold), float(s.quiet), float(s.fluctuating), float(s.share), float(s.lively),
            self.typical_noise, self._slew * elapsed, self._floor, own, release, noise,
        )  # fmt: skip
        self.typical_noise = update_baseline(
            self._estimates, window, healthy, self._neighbours, settings, self._afresh, self._room
        )
        self._afresh = False


def near(touched: NDArray[np.bool_], neighbours: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Finds the taxels (n,) that have a touched neighbour.

    `neighbours` (m, 2) are pairs of neighbouring taxels.
    """
    result = np.zeros(touched.size, dtype=bool)
    if touched.any():
        one, other = neighbours.T
        result[one[touched[other]]] = True
        result[other[touched[one]]] = True
    return result
