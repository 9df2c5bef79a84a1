"""Estimates the rest values, noise and health of one patch's taxels, window by window."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.description import SOLE
from tci.skin.baseline import Baseline, BaselineSettings
from tci.skin.fill_factor import is_surface
from tci.skin.health import Health, HealthSettings, TaxelHealth
from tci.skin.kernels.arrays import Estimates, Records, Statistics
from tci.skin.kernels.baseline import Window
from tci.skin.layout import SkinPatch

SATURATED = 0.9
"""A taxel counts as saturated if its signal exceeds this fraction of its range. The cause of such a signal is
pressure, not a shift of the rest value. Assumed: with 1, a saturated taxel with noise would be missed in
frames where the noise lowers its value."""
TWO_COUNTS = 1.5
"""Least deviation [counts] from the rest value that is treated as a deviation of two counts. The number is
less than 2 because the rest value may be between two counts."""


class PatchEstimator:
    """Estimates rest values, noise and health of the taxels of one patch from estimation windows."""

    def __init__(self, patch: SkinPatch, baseline: BaselineSettings, health: HealthSettings) -> None:
        sensor, pairs = patch.description.sensor, patch.surface.neighbours
        count, sign = len(patch.surface.areas), float(np.sign(sensor.pascal_per_count))
        self.sole = patch.description.segment == SOLE
        self.full = patch.full
        """Largest deviation [counts] within the sensor's range."""
        self._gain, self._response = patch.gain, patch.response
        self._two_counts = self._pressure(np.full(count, TWO_COUNTS))
        self.baseline = Baseline(
            count,
            span=sensor.highest - sensor.lowest,
            floor=min(sign * (end - sensor.rest) for end in (sensor.lowest, sensor.highest)),
            noise=sensor.noise,
            neighbours=pairs,
            settings=baseline,
        )
        self._fades = is_surface(patch.surface) & (not patch.description.through_joints)
        if patch.calibration is not None:
            rest = sign * (np.array(patch.calibration.rest) - sensor.rest)
            self.baseline.start(rest, patch.calibration.noise)
        self.health = TaxelHealth(count, full=self.full, neighbours=pairs, settings=health)
        self._raised = 0.0
        self._half: tuple[Window, Array, NDArray[np.bool_]] | None = None

    def update(self, statistics: Statistics, state: Records) -> bool:
        """Does half of the work that follows the end of an estimation window.

        The first call updates rest values and noise, the second call health. Returns True after the second
        call. The work is divided into halves because a whole update would be the longest computation in a
        period of a loop at 1 kHz. `statistics` of the patch's taxels and its `state` (a
        record of type `STATE`) describe the window.
        """
        if self._half is None:
            self._half = self._estimate(statistics, state)
            return False
        (window, before, raised), self._half = self._half, None
        self.health.judge(window, self.baseline, before)
        if self._is_step(raised & (window.mean < SATURATED * self.full), window.elapsed):
            self.rezero(statistics)
        return True

    def rezero(self, statistics: Statistics) -> None:
        """Uses the present readings as rest values."""
        self.baseline.rezero(statistics.signal.astype(np.float64))

    def write(self, taxels: slice, estimates: Estimates) -> None:
        """Writes the estimates for the compiled loop, in single precision, which is exact for whole counts
        below 2^24."""
        baseline = self.baseline
        estimates.offset[taxels] = baseline.offset
        estimates.threshold[taxels] = baseline.threshold
        estimates.fluctuating[taxels] = baseline.noise >= baseline.settings.lively
        self.write_health(taxels, estimates)

    def write_health(self, taxels: slice, estimates: Estimates) -> None:
        """Writes into `estimates`, for the `taxels` of this patch: which taxels are ignored (`muted`), and
        the pressures [Pa] `least`, `onset` (two counts) and `hidden`.

        The pressure `least`, above which a taxel is active, corresponds to at least one count. At the edge of
        a touch, pressures below `hidden` are not measured. `hidden` corresponds to at least half a count; it
        is 0 for taxels on which touches have no gradual edge.
        """
        threshold = self.baseline.threshold
        least = self._pressure(np.maximum(threshold, 1.0))
        estimates.least[taxels] = np.where(self.health.healthy, least, np.inf)
        estimates.onset[taxels] = np.where(self.baseline.rested, self._two_counts, np.inf)
        estimates.hidden[taxels] = np.where(self._fades, self._pressure(np.maximum(threshold, 0.5)), 0.0)
        estimates.muted[taxels] = self.health.muted

    def _pressure(self, counts: Array) -> Array:
        pressure: Array = self._gain * self._response(counts)
        return pressure

    def masked(self) -> MappingProxyType[int, str]:
        """Returns why taxels are not used, by taxel index. Each reason is `dead`, `stuck` or `noisy`."""
        state = self.health.state
        return MappingProxyType({int(i): Health(state[i]).name.lower() for i in np.flatnonzero(state)})

    def _estimate(self, statistics: Statistics, state: Records) -> tuple[Window, Array, NDArray[np.bool_]]:
        """Updates rest values and noise from the statistics of one estimation window.

        Returns these statistics as a `Window`, the rest values (n,) before the update, and an array (n,) that
        is True for taxels whose mean signal was above their threshold.
        """
        frames = state["in_window"]
        window = Window(
            elapsed=float(state["elapsed"]),
            mean=statistics.total.astype(float) / frames,
            peak=statistics.peak.astype(float),
            second_difference=statistics.second_difference.astype(float) / max(state["differences"], 1),
            changes=statistics.changes.astype(float) / frames,
        )
        before = self.baseline.offset.copy()
        raised = window.mean - before > self.baseline.threshold
        self.baseline.update(window, self.health.healthy)
        return window, before, raised

    def _is_step(self, raised: NDArray[np.bool_], elapsed: float) -> bool:
        """Returns True if nearly all taxels of the patch have been pressed for so long that the pressure
        counts as a shift of the rest values.

        `raised` (n,) is True for taxels that were pressed in the last `elapsed` [s]. For a sole the result is
        always False, since the robot's weight presses all its taxels while the robot stands.
        """
        settings, healthy = self.baseline.settings, self.health.healthy
        least = settings.step_share * max(int(np.count_nonzero(healthy)), 1)
        nearly_all = int(np.count_nonzero(raised & healthy)) >= least
        self._raised = self._raised + elapsed if nearly_all and not self.sole else 0.0
        if self._raised < settings.step:
            return False
        self._raised = 0.0
        return True
