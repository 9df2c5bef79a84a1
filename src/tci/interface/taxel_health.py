"""Which taxels can't be trusted: stuck, dead or noisy ones are masked until they behave again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array


class Health(IntEnum):
    """State of a taxel."""

    SOUND = 0
    """It is used."""
    DEAD = 1
    """Its value has not changed for long, at rest, while its patch flickers: masked."""
    STUCK = 2
    """The same while it reads pressure; or pressed to the end of its range all alone: masked."""
    NOISY = 3
    """Far noisier than its patch: masked."""


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When a taxel is no longer believed. All figures are ours."""

    still: float = 60.0
    """How long [s] a value may stay the same to the bit while others change."""
    noisy: float = 8.0
    """A taxel this many times as noisy as the median of its patch is masked, until half of that."""
    least_noise: float = 1.0
    """Noise [counts] below which no taxel is noisy."""

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
        self._full = full
        self._neighbours = neighbours
        self._unchanged = np.zeros(count)
        self._last: Array | None = None

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Which taxels (n,) are used."""
        sound: NDArray[np.bool_] = self.state == Health.SOUND
        return sound

    def update(self, signal: Array, deviation: Array, noise: Array, pressed: Array, elapsed: float) -> None:
        """Judge every taxel (n,), `elapsed` [s] after the last time.

        `signal` and `deviation` from rest in counts, `noise` its standard deviation, `pressed` the
        deviation from which a taxel feels something.
        """
        s = self.settings
        if self._last is None:
            self._last = signal
            return
        same = signal == self._last
        self._last = signal
        self._unchanged = np.where(same, self._unchanged + elapsed, 0.0)
        self.state[~same & (self.state != Health.NOISY)] = Health.SOUND
        still = self._unchanged > s.still
        if still.any():
            self._judge_still(still, deviation, pressed)
        middle = float(np.median(noise))
        limit = max(s.noisy * middle, s.least_noise)
        self.state[(noise > limit) & (self.state == Health.SOUND)] = Health.NOISY
        self.state[(noise < limit / 2.0) & (self.state == Health.NOISY)] = Health.SOUND

    def _judge_still(self, still: NDArray[np.bool_], deviation: Array, pressed: Array) -> None:
        touched = deviation > np.maximum(pressed, 1.0)
        # Where most taxels flicker, one that does not is no sensor; where none does, it means nothing.
        if 2 * np.count_nonzero(still) < still.size:
            near = self._near(touched)
            held = touched & near  # a lasting press may saturate a taxel, but not one alone
            self.state[still & ~touched] = Health.DEAD
            self.state[still & touched & ~held] = Health.STUCK
        else:
            full = still & (deviation >= 0.9 * self._full)
            self.state[full & ~self._near(touched)] = Health.STUCK

    def _near(self, touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which taxels (n,) have a touched neighbour."""
        result = np.zeros(touched.size, dtype=bool)
        one, other = self._neighbours.T
        result[one[touched[other]]] = True
        result[other[touched[one]]] = True
        return result
