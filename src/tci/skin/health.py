"""Detection of dead, stuck and noisy taxels. Such taxels are masked until they work again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.messages.frames import Array
from tci.skin.baseline import Baseline, near
from tci.skin.kernels.baseline import NOISE_GAIN, Window


class Health(IntEnum):
    """Health of a taxel: the reason for which the taxel is masked, or HEALTHY."""

    HEALTHY = 0
    """The taxel is in use."""
    DEAD = 1
    """The taxel is masked because it is at rest and constant for a long time, although the other taxels of
    its patch fluctuate."""
    STUCK = 2
    """The taxel is masked because it is active and constant, in one of these cases:

    - No neighbour is active, and the value is constant for a long time. If the taxel fluctuated before, one
      estimation window (about a second) is enough.
    - All taxels of the patch are constant for a long time.

    On a patch without noise, only a taxel at the end of its range, without an active neighbour, counts as
    stuck.
    """
    NOISY = 3
    """The taxel is masked because it is much noisier than the other taxels of its patch."""


_HEALTHY, _DEAD, _STUCK, _NOISY = map(int, Health)
"""Values of the states as plain integers, since a comparison of an array with a member of an enumeration
takes several times as long."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """Thresholds at which taxels are masked.

    All figures are assumed. With lower thresholds more healthy taxels are masked. With higher thresholds
    broken taxels are used for longer.
    """

    constant: float = 60.0
    """Time [s] for which a taxel's value may stay exactly constant while the values of other taxels change.
    """
    noisy: float = 8.0
    """A taxel is masked if its noise is more than this many times the median noise of the patch (of its
    taxels that were at rest). The taxel is masked until its noise is below half of this bound."""
    least_noise: float = 1.0
    """Noise [counts] below which no taxel counts as noisy."""
    flicker: float = 0.2
    """Median noise [counts] of a patch above which a taxel with a constant value counts as broken. On a patch
    with less noise the values of healthy taxels are constant too."""

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

        `full` [counts] is the largest deviation that the sensor can send. `neighbours` (m, 2) are pairs of
        neighbouring taxels.
        """
        self.settings = settings
        self.state = np.zeros(count, dtype=np.int8)
        """`Health` of each taxel (n,)."""
        self.muted = np.zeros(count, dtype=bool)
        """True (n,) for each taxel with a pressure that is ignored. Dead taxels are not included: their
        pressure is 0, and they are used again as soon as their value changes."""
        self.constant = False
        """True if any taxel was dead or stuck after the latest call of `judge`."""
        self._full = full
        self._neighbours = neighbours
        self._unchanged = np.zeros(count)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """Mask (n,) that is True for each taxel in use."""
        healthy: NDArray[np.bool_] = self.state == _HEALTHY
        return healthy

    def revive(self, changed: NDArray[np.bool_]) -> None:
        """Ends the masking of dead and stuck taxels whose value has `changed` (n,). These taxels are used
        again from the next frame on."""
        self.state[changed & (self.state != _NOISY)] = _HEALTHY
        self.muted &= ~(changed & (self.state == _HEALTHY))

    def judge(self, window: Window, baseline: Baseline, offset: Array) -> None:
        """Updates the health of every taxel (n,) from one estimation window.

        The `baseline` gives the noise and the thresholds. `offset` (n,) [counts] are the rest values before
        the window.
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
