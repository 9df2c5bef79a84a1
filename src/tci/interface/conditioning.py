"""From raw frames of a patch to the pressure on its taxels.

Each robot's sensor has its own numbers: polarity, range and response come from the description, rest values
and noise are learnt, and taxels that can't be trusted are masked, so that above this module all skins speak
pascal (§3.2: readings are normalised in layer L3). The same frames give the same pressures, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, TciError
from tci.frames import Array
from tci.interface.baseline import Baseline, BaselineSettings
from tci.interface.taxel_health import Health, HealthSettings, TaxelHealth
from tci.model.description import Patch

GAP = 1.0
"""Longest time [s] between two frames that anything is learnt for at once. Ours."""


@dataclass(frozen=True, slots=True)
class ConditioningSettings:
    """How frames become pressures."""

    baseline: BaselineSettings = field(default_factory=BaselineSettings)
    """Rest values, drift, noise."""
    health: HealthSettings = field(default_factory=HealthSettings)
    """When taxels are masked."""
    latency: float = 0.0
    """Time constant [s] of smoothing: pressures come at most this much later. 0: none."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.latency < np.inf:
            raise TciError(f"latency {self.latency} s; valid: 0 or more, finite")


@dataclass(frozen=True, slots=True)
class PatchHealth:
    """How much of a patch can be trusted."""

    coverage: float
    """Share 0..1 of its taxels that are used."""
    masked: Mapping[int, str]
    """Why each of the others is not, by index: `dead`, `stuck`, `noisy`."""
    saturated: int
    """Taxels at the end of their range now: a valid touch, its amplitude capped."""
    dropped: int
    """Values until now that were not finite, or that the sensor can't send."""


class Conditioner:
    """Turns the raw frames of one patch into pressures.

    One lives as long as the patch's link is open: what is learnt about its taxels belongs here.
    """

    def __init__(
        self,
        patch: Patch,
        channels: NDArray[np.intp],
        *,
        neighbours: NDArray[np.intp] | None = None,
        settings: ConditioningSettings | None = None,
    ) -> None:
        """`channels` (taxels,) are the places of the taxels in the raw frame, `neighbours` (m, 2) pairs of
        taxels that touch."""
        self.patch = patch
        self.channels = channels
        self.dropped = 0
        """Values dropped until now: not finite, or none that the sensor can send."""
        self.settings = settings or ConditioningSettings()
        sensor = patch.sensor
        self._sign = np.sign(sensor.pascal_per_count)
        self._full = (sensor.highest - sensor.rest) if self._sign > 0 else (sensor.rest - sensor.lowest)
        count = len(channels)
        pairs = np.zeros((0, 2), dtype=np.intp) if neighbours is None else neighbours
        span = sensor.highest - sensor.lowest
        self.baseline = Baseline(count, span=span, noise=sensor.noise, settings=self.settings.baseline)
        """What the taxels read at rest."""
        self._health = TaxelHealth(count, full=self._full, neighbours=pairs, settings=self.settings.health)
        self._saturated = np.zeros(count, dtype=bool)
        self._stamp: float | None = None
        self._smooth: Array | None = None

    @property
    def masked(self) -> NDArray[np.bool_]:
        """Which taxels (n,) are ignored."""
        return ~self._health.sound

    @property
    def health(self) -> PatchHealth:
        """What was found out about the taxels until now."""
        state = self._health.state
        masked = {int(i): Health(state[i]).name.lower() for i in np.flatnonzero(state)}
        coverage = 1.0 - len(masked) / max(len(state), 1)
        saturated = int(np.count_nonzero(self._saturated))
        return PatchHealth(coverage, MappingProxyType(masked), saturated, self.dropped)

    def rezero(self) -> None:
        """What the taxels read now is rest: after a step of the baseline, or on an operator's word."""
        self.baseline.rezero()

    def pressure(self, values: NDArray[np.generic], stamp: float | None = None) -> Array:
        """Pressure (taxels,) [Pa] of a raw frame (channels,) at `stamp` [s]: never negative, always finite.

        Without a stamp nothing is learnt from the frame. A value that is not finite, or that the sensor
        can't send, counts as the taxel's rest. Raises FrameError for another number of values, or for
        values that are no real numbers.
        """
        values = np.asarray(values)
        self._check(values)
        sensor = self.patch.sensor
        # Sensors send small and unsigned numbers; their differences need room.
        raw = values[self.channels].astype(np.float64)
        good = (raw >= sensor.lowest) & (raw <= sensor.highest)
        signal = self._sign * (raw - sensor.rest)
        if not good.all():
            self.dropped += int(good.size - np.count_nonzero(good))
            signal[~good] = self.baseline.offset[~good]
        self._saturated = signal >= self._full
        elapsed = 0.0
        if stamp is not None:
            elapsed = 0.0 if self._stamp is None else min(max(stamp - self._stamp, 0.0), GAP)
            self._stamp = stamp
        learns = stamp is not None
        deviation = (
            self.baseline.update(signal, good & self._health.sound, elapsed)
            if learns
            else (signal - self.baseline.offset)
        )
        threshold = self.baseline.threshold
        if learns:
            self._health.update(signal, deviation, self.baseline.noise, threshold, elapsed)
        felt = np.where((deviation >= threshold) & self._health.sound, np.maximum(deviation, 0.0), 0.0)
        pressure = sensor.pressure(felt)
        if self.settings.latency > 0.0 and elapsed > 0.0 and self._smooth is not None:
            share = 1.0 - np.exp(-elapsed / self.settings.latency)
            pressure = self._smooth + share * (pressure - self._smooth)
        self._smooth = pressure
        return pressure

    def _check(self, values: NDArray[np.generic]) -> None:
        name, expected = self.patch.name, (self.patch.channels,)
        if values.shape != expected:
            raise FrameError(
                f"{name}: frame of shape {values.shape}, expected {expected}, one value per channel"
            )
        if values.dtype.kind not in "uif":
            raise FrameError(
                f"{name}: frame of type {values.dtype}, expected integers or floating point numbers"
            )
