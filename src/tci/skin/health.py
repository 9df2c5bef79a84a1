"""Which taxels can't be trusted: stuck, dead or noisy ones are masked until they behave again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array
from tci.skin.baseline import NOISE_GAIN, Window, median, near


class Health(IntEnum):
    """State of a taxel."""

    HEALTHY = 0
    """It is used."""
    DEAD = 1
    """Its value has not changed for long, at rest, though its patch flickers: masked."""
    STUCK = 2
    """The same while it reads pressure, all alone for a window only; or pressed to the end of its range all
    alone: masked."""
    NOISY = 3
    """Far noisier than its patch: masked."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When a taxel is no longer believed. All figures are ours."""

    constant: float = 60.0
    """How long [s] a value may stay the same to the bit while others change."""
    fluctuating: float = 0.4
    """Noise [counts] from which a taxel that reads pressure all alone, the same to the bit for one window,
    is stuck: a third of such a taxel's frames differ, so that chance gives 50 alike once in 1e5 windows."""
    noisy: float = 8.0
    """A taxel this many times as noisy as the median of its patch is masked, until half of that."""
    least_noise: float = 1.0
    """Noise [counts] below which no taxel is noisy."""
    flicker: float = 0.2
    """Noise [counts] that a patch must have for the silence of a taxel, or of all, to mean something."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"health: {field.name} {value}; valid: above 0 and finite")


class TaxelHealth:
    """Watches the taxels of one patch."""

    def __init__(
        self, count: int, *, full: float, neighbours: NDArray[np.intp], settings: HealthSettings
    ) -> None:
        """`full` [counts] is the largest deviation that the sensor can show; `neighbours` (m, 2) pairs of
        taxels that touch."""
        self.settings = settings
        self.state = np.zeros(count, dtype=np.int8)
        """`Health` of each taxel (n,)."""
        self.muted = np.zeros(count, dtype=bool)
        """Taxels (n,) whose pressure is not believed. A dead one has none, and should it change, it lives."""
        self.constant = False
        """Whether a taxel is dead or stuck."""
        self._full = full
        self._neighbours = neighbours
        self._unchanged = np.zeros(count)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """Which taxels (n,) are used."""
        healthy: NDArray[np.bool_] = self.state == Health.HEALTHY
        return healthy

    def revive(self, changed: NDArray[np.bool_]) -> None:
        """Taxels that were dead or stuck and `changed` (n,) are believed again, from the next frame on."""
        self.state[changed & (self.state != Health.NOISY)] = Health.HEALTHY
        self.muted &= ~(changed & (self.state == Health.HEALTHY))

    def judge(self, window: Window, offset: Array, noise: Array, threshold: Array) -> None:
        """Judge every taxel (n,) by a window: `offset` is its rest value, `noise` its standard deviation,
        `threshold` the deviation from which it feels something, all in counts."""
        s = self.settings
        deviation = window.mean - offset
        changed = window.changes > 0.0
        self._unchanged = np.where(changed, 0.0, self._unchanged + window.elapsed)
        constant = self._unchanged > s.constant
        middle = median(noise)
        if constant.any():
            self._judge_constant(constant, deviation, threshold, middle)
        frozen = ~changed & (noise >= s.fluctuating)
        if frozen.any():
            touched = _touched(deviation, threshold)
            self.state[frozen & touched & ~near(touched, self._neighbours)] = Health.STUCK
        limit = max(s.noisy * middle, s.least_noise)
        present = window.second_difference / NOISE_GAIN
        self.state[(noise > limit) & (self.state == Health.HEALTHY)] = Health.NOISY
        # What a masked taxel sends contributes nothing, so that its release goes by the window itself.
        self.state[(present < limit / 2.0) & (self.state == Health.NOISY)] = Health.HEALTHY
        self.constant = bool(((self.state == Health.DEAD) | (self.state == Health.STUCK)).any())
        self.muted[:] = (self.state == Health.STUCK) | (self.state == Health.NOISY)

    def _judge_constant(
        self, constant: NDArray[np.bool_], deviation: Array, threshold: Array, middle: float
    ) -> None:
        touched = _touched(deviation, threshold)
        alone = touched & ~near(touched, self._neighbours)
        # Where taxels flicker, one that does not is no sensor; where none ever did, it means nothing.
        if middle > self.settings.flicker:
            self.state[constant & ~touched] = Health.DEAD
            # A lasting press may saturate a taxel, but not one alone, nor all of a patch.
            self.state[constant & (alone | (touched & bool(constant.all())))] = Health.STUCK
        else:
            self.state[constant & alone & (deviation >= 0.9 * self._full)] = Health.STUCK


def _touched(deviation: Array, threshold: Array) -> NDArray[np.bool_]:
    touched: NDArray[np.bool_] = deviation > np.maximum(threshold, 2.0)
    return touched
