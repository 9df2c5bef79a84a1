"""Conditioning: turns raw frames of all patches into pressure on their taxels.

The polarity, range and response of each sensor come from the description. Rest values and noise are estimated
from the frames. Taxels that can't be trusted are masked. All later stages work with pressures in pascal, so
that these stages do not depend on the sensor (§3.2: readings are normalised in layer L3). The result is
deterministic: equal frames give equal pressures, bit for bit.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import gt

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError, UnknownNameError
from tci.messages import SkinFrame, SkinState
from tci.messages.frames import frozen
from tci.skin.baseline import BaselineSettings
from tci.skin.estimation import PatchEstimator
from tci.skin.frame_buffer import FrameBuffer
from tci.skin.health import Health, HealthSettings
from tci.skin.kernels.arrays import ActiveTaxels, Estimates, SkinMemory
from tci.skin.kernels.condition import condition, condition_of_floats
from tci.skin.layout import SkinLayout
from tci.skin.shear import ForceVectors

RESTART = 1.0
"""If a frame has a lower sequence number than the previous frame, but its stamp is later by more than this
time [s], the sender counts as restarted. Assumed: with a shorter time, a frame out of order could look like a
restart. With a longer time, the frames of a restarted sender would be ignored for longer."""
_CONDITION = {"B": condition, "f": condition_of_floats}
"""Loop for each type of raw values: uint8 and float32."""


@dataclass(frozen=True, slots=True)
class ConditioningSettings:
    """Settings of conditioning."""

    baseline: BaselineSettings = field(default_factory=BaselineSettings)
    """Estimation of rest values, drift and noise."""
    health: HealthSettings = field(default_factory=HealthSettings)
    """Conditions under which taxels are masked."""
    latency: float = 0.0
    """Time constant [s] of the low-pass filter on pressures. 0 means no filter. Pressures are delayed by at
    most this time."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.latency < np.inf:
            raise TciError(f"latency {self.latency} s; valid: 0 or more, finite")


@dataclass(frozen=True, slots=True)
class PatchHealth:
    """Health of the taxels of one patch."""

    coverage: float
    """Fraction (0..1) of the patch's taxels that are in use."""
    masked: Mapping[int, str]
    """Reason for each taxel that is not in use, by index: `dead`, `stuck` or `noisy`."""
    saturated: int
    """Number of taxels that are at the end of their range now. A touch on a saturated taxel is valid, but
    the touch's force is only a lower bound."""
    dropped: int
    """Number of values so far that were not finite or were outside the sensor's range."""


class Conditioner:
    """Converts raw frames to pressures. Contains the statistics and estimates of all taxels of one skin."""

    def __init__(self, layout: SkinLayout, settings: ConditioningSettings = ConditioningSettings()) -> None:
        self.layout, self.settings = layout, settings
        self.late = 0
        """Number of frames so far that arrived after a newer frame of their patch. These frames are
        ignored."""
        self.estimators = tuple(
            PatchEstimator(patch, settings.baseline, settings.health) for patch in layout.patches
        )
        """Estimators of rest values, noise and health, one for each patch."""
        taxels, patches = len(layout.arrays.taxels), len(layout.patches)
        self._buffer = FrameBuffer(layout)
        self.estimates = Estimates.initial(taxels)
        self._memory = SkinMemory.initial(patches, taxels, smooth=settings.latency > 0.0)
        state = self._memory.patches
        state["stamp"], state["repeats"] = np.nan, -1
        state["due"], state["least"] = settings.baseline.window, settings.baseline.frames
        # The second windows of the patches differ in length, so that they end in different frames.
        self._stagger = 0.5 * np.arange(patches) / max(patches, 1)
        self._out = ActiveTaxels(
            stamp=np.full(patches, np.nan),
            begin=np.zeros(patches + 1, np.int64),
            active=np.zeros(taxels, np.int32),
            pressure=np.zeros(taxels),
        )
        self._sequence = np.full(patches, -1, np.int64)
        self._vectors = ForceVectors(layout)
        self._ended: list[int] = []
        for estimator, own in zip(self.estimators, layout.taxels, strict=True):
            estimator.write(own, self.estimates)
        self._masked: NDArray[np.bool_] | None = None
        self.state = self._state()
        """Pressures in the latest frames."""

    @property
    def dropped(self) -> int:
        """Number of values so far that were not finite or were outside their sensor's range."""
        return int(self._memory.patches["dropped"].sum())

    @property
    def health(self) -> dict[str, PatchHealth]:
        """Returns the health of each patch by its name."""
        self.catch_up()
        found = {}
        for site, estimator, state in zip(
            self.layout.sites, self.estimators, self._memory.patches, strict=True
        ):
            masked = estimator.masked()
            coverage = 1.0 - len(masked) / max(len(estimator.health.state), 1)
            found[site.patch] = PatchHealth(
                coverage, masked, saturated=int(state["saturated"]), dropped=int(state["dropped"])
            )
        return found

    def copy(self) -> Conditioner:
        """Returns an independent copy with the present estimates and statistics."""
        return copy.deepcopy(self)

    def step(self, frames: Sequence[SkinFrame]) -> bool:
        """Processes the frames that are newer than the last frame of their patch.

        Returns False if no frame is newer.

        If frames are out of order, the newest frame is used. Raises FrameError, and changes nothing, if a
        frame does not fit its patch.
        """
        if not frames:
            return False
        names, buffer = tuple([frame.patch for frame in frames]), self._buffer
        if names != buffer.names:
            if len({*names}) < len(names):
                return self._step_each(frames)
            buffer.arrange(names)
        sequences = [frame.sequence for frame in frames]
        known = (self._sequence if buffer.whole else self._sequence[buffer.which]).tolist()
        if not all(map(gt, sequences, known)):
            stamps = self.state.stamp.tolist()
            fresh = [
                frame for frame, last, p in zip(frames, known, buffer.order, strict=True)
                if frame.sequence > last or not frame.stamp <= stamps[p] + RESTART
            ]  # fmt: skip
            if len(fresh) < len(frames):
                late = self._older(frames) - self._older(fresh)
                taken = self.step(fresh)
                self.late += late
                return taken
        values = [*map(np.asarray, [frame.values for frame in frames])]
        buffer.check(values)
        self.catch_up()
        buffer.fill(values)
        # Each step needs a new array, because the states refer to this array.
        sequence = np.array(sequences, np.int64)
        if not buffer.whole:
            every = self._sequence.copy()
            every[buffer.which] = sequence
            sequence = every
        self._sequence = sequence
        self._condition(frames)
        return True

    def update(self) -> bool:
        """Does half of an update of one patch, which is due after the end of an estimation window of the
        patch. The first call updates rest values and noise, a second call the health of the taxels.

        Returns False if no update is due.

        If this method is not called, `step` does the update when the next frame arrives, with an equal
        result. So a caller with spare time can call `update`, to shorten the next `step`.
        """
        if not self._ended:
            return False
        p = self._ended[-1]
        self._count_repeats(p)
        statistics = self._memory.statistics.of(self.layout.taxels[p])
        if self.estimators[p].update(statistics, self._memory.patches[p]):
            self._ended.pop()
            self._restart(p)
        return True

    def catch_up(self) -> None:
        """Completes all updates of the estimates that are due because an estimation window has ended."""
        while self.update():
            pass

    def rezero(self, patch: str) -> None:
        """Takes the present readings of a patch as its rest values.

        Raises UnknownNameError for an unknown patch.
        """
        if (p := self.layout.places.get(patch)) is None:
            raise UnknownNameError("skin patch", patch, self.layout.places)
        if self._memory.patches[p]["frames"]:
            self.catch_up()
            self.estimators[p].rezero(self._memory.statistics.of(self.layout.taxels[p]))
            self._restart(p)

    def _step_each(self, frames: Sequence[SkinFrame]) -> bool:
        """Processes frames one by one, also several of one patch. Returns True if any frame was new."""
        for frame in frames:
            self._buffer.arrange((frame.patch,))
            self._buffer.check([np.asarray(frame.values)])
        taken = [self.step([frame]) for frame in frames]  # a list, so that all frames are processed
        return any(taken)

    def _older(self, frames: Sequence[SkinFrame]) -> int:
        known, places = self._sequence.tolist(), self.layout.places
        return sum([frame.sequence < known[places[frame.patch]] for frame in frames])

    def _condition(self, frames: Sequence[SkinFrame]) -> None:
        memory, buffer = self._memory, self._buffer
        stamps = np.array([frame.stamp for frame in frames], np.float64)
        ended = _CONDITION[buffer.raw.dtype.char](
            buffer.raw, buffer.last, buffer.which, stamps, self.settings.latency, self.layout.arrays,
            self.estimates, memory, self._out,
        )  # fmt: skip
        if self._masked is not None:
            self._revive(buffer.order)
        if ended:
            state = memory.patches
            over = (state["elapsed"] >= state["due"]) & (state["in_window"] >= state["least"])
            self._ended = [p for p in buffer.order if over[p]]
        self._vectors.step(buffer.which, frames, self._out)
        self.state = self._state()

    def _state(self) -> SkinState:
        out, begin = self._out, self._out.begin.copy()
        found = int(begin[-1])
        return SkinState(
            self.layout.starts, out.stamp.copy(), self._sequence, begin, out.active[:found].copy(),
            out.pressure[:found].copy(), self._vectors.latest(out), self._masked,
        )  # fmt: skip

    def _revive(self, patches: list[int]) -> None:
        """Uses dead and stuck taxels of the patches with the indices `patches` again, from the next frame on,
        if their values have changed."""
        for p in patches:
            estimator, own = self.estimators[p], self.layout.taxels[p]
            if estimator.health.constant:
                before = estimator.health.state.copy()
                estimator.health.revive(self._memory.statistics.changes[own] > 0.0)
                if not np.array_equal(before, estimator.health.state):
                    estimator.write_health(own, self.estimates)
                    self._mask()
                    self._note_anew(p)

    def _count_repeats(self, p: int) -> None:
        """Adds those frames of the patch with index `p` to the statistics that equal the previous frame and
        were therefore only counted so far."""
        state, own = self._memory.patches[p], self.layout.taxels[p]
        if state["repeats"] > 0:
            statistics = self._memory.statistics
            statistics.total[own] += np.float32(state["repeats"]) * statistics.signal[own]
            state["repeats"] = 0

    def _note_anew(self, p: int) -> None:
        """Ensures that the next frame of the patch with index `p` is processed in full, even if its values
        equal those of the previous frame."""
        self._count_repeats(p)
        self._memory.patches[p]["repeats"] = -1

    def _restart(self, p: int) -> None:
        """Begins a new estimation window for the patch with index `p`. At the end of each window, rest values
        and noise are updated."""
        self._note_anew(p)
        own, state, statistics = self.layout.taxels[p], self._memory.patches[p], self._memory.statistics
        for window in (statistics.total, statistics.peak, statistics.second_difference, statistics.changes):
            window[own] = 0.0
        state["in_window"] = state["differences"] = state["elapsed"] = 0
        state["due"] = self.settings.baseline.window * (1.0 + self._stagger[p])
        self._stagger[p] = 0.0
        self.estimators[p].write(own, self.estimates)
        self._mask()

    def _mask(self) -> None:
        states = [estimator.health.state for estimator in self.estimators]
        masked = any(map(np.count_nonzero, states))
        self._masked = frozen(np.concatenate(states) != Health.HEALTHY) if masked else None
