"""Detection of dead, stuck and noisy taxels. They are masked until they work again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array
from tci.skin.baseline import Baseline, near
from tci.skin.kernels.baseline import NOISE_GAIN, Window


class Health(IntEnum):
    """State of a taxel."""

    HEALTHY = 0
    """In use."""
    DEAD = 1
    """At rest and constant for a long time, although its patch fluctuates: masked."""
    STUCK = 2
    """Masked because it is active and constant: without an active neighbour, for a long time or, if it
    fluctuated before, for one window; or together with its whole patch for a long time. On a patch without
    noise only at the end of the range."""
    NOISY = 3
    """Much noisier than its patch: masked."""


_HEALTHY, _DEAD, _STUCK, _NOISY = map(int, Health)
"""Values of the states, since comparing an array with a member of an enumeration takes several times as
long."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """Thresholds at which taxels are masked. All figures are assumed. With lower figures more healthy taxels
    are masked, with higher ones broken taxels are trusted for longer."""

    constant: float = 60.0
    """Time [s] for which a value may stay exactly constant while others change."""
    noisy: float = 8.0
    """A taxel is masked if its noise is this many times the median noise of its patch's taxels that were at
    rest, until its noise is half of that."""
    least_noise: float = 1.0
    """Noise [counts] below which no taxel counts as noisy."""
    flicker: float = 0.2
    """Median noise [counts] of a patch above which a constant taxel counts as broken. On a patch without
    fluctuations, healthy taxels are constant too."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"health: {field.name} {value}; valid: above 0 and finite")


class TaxelHealth:
    """Health of the taxels of one patch, judged window by window."""

    def __init__(
        self, count: int, *, full: float, neighbours: NDArray[np.intp], settings: HealthSettings
    ) -> None:
        """Starts with all taxels healthy.

        `full` [counts] is the largest deviation that the sensor can send; `neighbours` (m, 2) are pairs of
        neighbouring taxels.
        """
        self.settings = settings
        self.state = np.zeros(count, dtype=np.int8)
        """`Health` of each taxel (n,)."""
        self.muted = np.zeros(count, dtype=bool)
        """Taxels (n,) whose pressure is ignored. Dead taxels are not included: they read no pressure, and are
        trusted again immediately when their value changes."""
        self.constant = False
        """True if any taxel is dead or stuck."""
        self._full = full
        self._neighbours = neighbours
        self._unchanged = np.zeros(count)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """Mask (n,) of the taxels in use."""
        healthy: NDArray[np.bool_] = self.state == _HEALTHY
        return healthy

    def revive(self, changed: NDArray[np.bool_]) -> None:
        """Trusts dead and stuck taxels that `changed` (n,) again, from the next frame on."""
        self.state[changed & (self.state != _NOISY)] = _HEALTHY
        self.muted &= ~(changed & (self.state == _HEALTHY))

    def judge(self, window: Window, baseline: Baseline, offset: Array) -> None:
        """Updates the health of every taxel (n,) from a window, the noise and thresholds of the `baseline`,
        and the rest values `offset` (n,) [counts] before the window.
        """
        s, noise, threshold = self.settings, baseline.noise, baseline.threshold
        deviation = window.mean - offset
        changed = window.changes > 0.0
        self._unchanged += window.elapsed
        self._unchanged[changed] = 0.0
        constant = self._unchanged > s.constant
        middle = baseline.typical_noise
        if np.count_nonzero(constant):
            self._judge_constant(constant, deviation, threshold, middle)
        if np.count_nonzero(baseline.frozen):
            touched = _touched(deviation, threshold)
            self.state[baseline.frozen & touched & ~near(touched, self._neighbours)] = _STUCK
        limit = max(s.noisy * middle, s.least_noise)
        present = window.second_difference / NOISE_GAIN
        self.state[(noise > limit) & (self.state == _HEALTHY)] = _NOISY
        # The noise of a masked taxel is no longer estimated, so the window itself decides on its release.
        self.state[(present < limit / 2.0) & (self.state == _NOISY)] = _HEALTHY
        stuck = self.state == _STUCK
        self.constant = bool(np.count_nonzero((self.state == _DEAD) | stuck))
        self.muted[:] = stuck | (self.state == _NOISY)

    def _judge_constant(
        self, constant: NDArray[np.bool_], deviation: Array, threshold: Array, middle: float
    ) -> None:
        touched = _touched(deviation, threshold)
        alone = touched & ~near(touched, self._neighbours)
        # Constant values show a defect only on a patch that fluctuates at rest.
        if middle > self.settings.flicker:
            self.state[constant & ~touched] = _DEAD
            # A lasting press may saturate a taxel, but neither a single one nor a whole patch.
            self.state[constant & (alone | (touched & bool(constant.all())))] = _STUCK
        else:
            self.state[constant & alone & (deviation >= 0.9 * self._full)] = _STUCK


def _touched(deviation: Array, threshold: Array) -> NDArray[np.bool_]:
    touched: NDArray[np.bool_] = deviation > np.maximum(threshold, 2.0)
    return touched
