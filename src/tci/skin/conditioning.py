"""From raw frames of a patch to the pressure on its taxels.

Each robot's sensor has its own numbers: polarity, range and response come from the description, rest values
and noise are learnt, and taxels that can't be trusted are masked, so that above this module all skins speak
pascal (§3.2: readings are normalised in layer L3). The same frames give the same pressures, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, TciError
from tci.frames import Array, doubles, read_only
from tci.robot.description import SOLE, Patch
from tci.robot.skin_files.calibration import PatchCalibration
from tci.skin.baseline import Baseline, BaselineSettings, Window
from tci.skin.health import Health, HealthSettings, TaxelHealth
from tci.skin.kernels.condition import (
    BEFORE,
    BEND,
    CHANGED,
    PEAK,
    RAW,
    SIGNAL,
    TOTAL,
    condition,
    empty_memory,
)

GAP = 1.0
"""Longest time [s] between two frames that anything is learnt for at once. Ours."""
SATURATED = 0.9
"""Share of the range from which a taxel is at its end, not stepped. Ours."""


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
        calibration: PatchCalibration | None = None,
        phase: float = 0.0,
    ) -> None:
        """`channels` (taxels,) are the places of the taxels in the raw frame, `neighbours` (m, 2) pairs of
        taxels that touch. A `calibration` takes the place of the description's rest, noise and response.
        The second lesson is longer by the share `phase`, so that patches do not all learn in the same frame.

        Raises TciError for a calibration of another number of taxels.
        """
        self.patch = patch
        self.channels = np.ascontiguousarray(channels, dtype=np.intp)
        self.dropped = 0
        """Values dropped until now: not finite, or none that the sensor can send."""
        self.settings = settings or ConditioningSettings()
        sensor = patch.sensor
        self.sign = float(np.sign(sensor.pascal_per_count))
        full = (sensor.highest - sensor.rest) if self.sign > 0 else (sensor.rest - sensor.lowest)
        count = len(channels)
        pairs = np.zeros((0, 2), dtype=np.intp) if neighbours is None else neighbours
        self.baseline = Baseline(
            count,
            span=sensor.highest - sensor.lowest,
            floor=min(self.sign * (end - sensor.rest) for end in (sensor.lowest, sensor.highest)),
            noise=sensor.noise,
            neighbours=pairs,
            settings=self.settings.baseline,
        )
        """What the taxels read at rest."""
        response = sensor.response
        if calibration is not None:
            calibration.check(count)
            self.baseline.start(self.sign * (np.array(calibration.rest) - sensor.rest), calibration.noise)
            response = calibration.response
        self._health = TaxelHealth(count, full=full, neighbours=pairs, settings=self.settings.health)
        self.sensor = np.array([sensor.lowest, sensor.highest, sensor.rest, self.sign, full], np.float32)
        self.nodes = np.array(response).T.copy() if response else np.zeros((2, 0))
        self.gain = np.full(count, 1.0 if response else abs(sensor.pascal_per_count))
        self.memory = empty_memory(count)
        self._active = np.zeros(count, np.uint8)
        self._pressure = np.zeros(count)
        self._masked = read_only(self._health.state, np.bool_)
        self._least: Array | None = None
        self._saturated = 0
        self._frames = self._in_lesson = self._bends = 0
        self.ended = False
        """A lesson has ended from which nothing has been learnt yet."""
        self._half: tuple[Window, Array, NDArray[np.bool_]] | None = None
        self._due, self._phase = self.settings.baseline.window, phase
        self._elapsed = self._raised = 0.0
        self._stamp: float | None = None
        self._values: object = None
        self._repeats = 0
        self._round()

    @property
    def masked(self) -> NDArray[np.bool_]:
        """Which taxels (n,) are ignored: an array that nobody changes."""
        return self._masked

    @property
    def least(self) -> Array:
        """Pressure (n,) [Pa] from which taxels feel something, at least one count; masked ones: infinite."""
        if self._least is None:
            counts = np.maximum(self.baseline.threshold, 1.0)
            pressure = np.interp(counts, *self.nodes) if self.nodes.size else self.gain * counts
            self._least = read_only(np.where(self._masked, np.inf, pressure))
        return self._least

    @property
    def lively(self) -> NDArray[np.bool_]:
        """Which taxels (n,) have so much noise that their values never stay the same for long."""
        lively: NDArray[np.bool_] = self.baseline.noise >= self.settings.health.fluctuating
        return lively

    @property
    def silent(self) -> NDArray[np.bool_]:
        """Which taxels (n,) are not believed."""
        return self._health.muted

    @property
    def still(self) -> bool:
        """Whether a taxel is dead or stuck, so that a change of it counts."""
        return self._health.constant

    @property
    def lesson(self) -> tuple[float, float, int, int]:
        """Time since this lesson began and when it ends [s], frames and second differences in it."""
        return self._elapsed, self._due, self._in_lesson, self._bends

    def resume(
        self, *, stamp: float | None, elapsed: float, frames: int, in_lesson: int, bends: int, saturated: int
    ) -> None:
        """Go on from what somebody else counted: stamp [s] of the latest frame, time [s] since the lesson
        began, frames seen, frames and second differences in the lesson, taxels at the end of their range."""
        self._stamp, self._elapsed, self._frames = stamp, elapsed, frames
        self._in_lesson, self._bends, self._saturated = in_lesson, bends, saturated
        self._values = None

    def revive(self, changed: NDArray[np.bool_]) -> None:
        """Taxels that were dead or stuck and `changed` (n,) are believed again, from the next frame on."""
        self._health.revive(changed)
        self._masked, self._least = read_only(self._health.state, np.bool_), None

    @property
    def health(self) -> PatchHealth:
        """What was found out about the taxels until now."""
        self.catch_up()
        state = self._health.state
        masked = {int(i): Health(state[i]).name.lower() for i in np.flatnonzero(state)}
        coverage = 1.0 - len(masked) / max(len(state), 1)
        return PatchHealth(coverage, MappingProxyType(masked), self._saturated, self.dropped)

    def rezero(self) -> None:
        """What the taxels read now is rest: after a step of the baseline, or on an operator's word."""
        if self._frames:
            self.catch_up()
            self._count_repeats()
            self.baseline.rezero(self.memory[SIGNAL].astype(np.float64))
            self._round()
            self._forget()

    def pressure(self, values: NDArray[np.generic], stamp: float | None = None) -> Array:
        """Pressure (taxels,) [Pa] of a raw frame (channels,) at `stamp` [s]: never negative, always finite.

        Without a stamp nothing is learnt from the frame. What a lesson teaches counts from the frame after it
        on. A value that is not finite, or that the sensor
        can't send, counts as the taxel's rest. The same read-only array again is the same frame again: it is
        only counted. Raises FrameError for another number of values, or for values that are no real numbers.
        """
        self.catch_up()
        elapsed = 0.0
        if stamp is not None:
            elapsed = 0.0 if self._stamp is None else min(max(stamp - self._stamp, 0.0), GAP)
            self._stamp = stamp
        if values is self._values:
            self._repeats += 1
            self.dropped += self._dropped
        else:
            self._condition(np.asarray(values), elapsed)
        self._bends += self._frames == 2
        self._frames = min(self._frames + 1, 2)
        self._in_lesson += 1
        self._elapsed += elapsed
        self.ended = self._elapsed >= self._due and self._in_lesson >= self.settings.baseline.frames
        return self._pressure

    def _condition(self, values: NDArray[np.generic], elapsed: float) -> None:
        """Go through all taxels."""
        self.check(values)
        self._count_repeats()
        latency = self.settings.latency
        smooth = latency > 0.0 and elapsed > 0.0
        pressure = np.zeros(len(self.channels))
        self._dropped, self._saturated = condition(
            values if values.dtype == np.uint8 else doubles(values),
            self.channels,
            self.sensor,
            self.offset,
            self.threshold,
            self._health.muted,
            self.gain,
            self.nodes,
            self.memory,
            self._active,
            self._frames,
            1.0 - math.exp(-elapsed / latency) if smooth else 1.0,
            self._pressure,
            pressure,
        )
        self._pressure = pressure
        self.dropped += self._dropped
        settled = self._frames == 2 and latency == 0.0 and not self._health.constant
        self._values = values if settled and not values.flags.writeable else None
        if self._health.constant:
            self.revive(self.memory[CHANGED] > 0.0)

    def _count_repeats(self) -> None:
        """Note in the memory what frames left there that were the same as the one before."""
        if self._repeats:
            memory = self.memory
            memory[BEND] += np.abs(memory[BEFORE] - memory[SIGNAL])
            memory[BEFORE] = memory[SIGNAL]
            memory[TOTAL] += np.float32(self._repeats) * memory[SIGNAL]
            self._repeats = 0

    def catch_up(self) -> None:
        """Learn from the lesson that ended: at any time between two frames the result is the same."""
        while self.ended:
            self.learn()

    @property
    def halfway(self) -> bool:
        """Whether the first half of a lesson is learnt, and the second is not."""
        return self._half is not None

    def learn(self) -> bool:
        """Learn half of a lesson that has ended: rest values and noise, then which taxels are believed. True
        when it is all learnt.

        Both at once are the longest that a loop at 1 kHz does in one period.
        """
        if self._half is None:
            self._half = self._teach()
            return False
        (lesson, before, raised), self._half, self.ended = self._half, None, False
        self._health.judge(lesson, before, self.baseline.noise, self.baseline.threshold)
        self._masked = read_only(self._health.state, np.bool_)
        self._round()
        self._forget()
        self._step(raised & (lesson.mean < SATURATED * self.sensor[-1]), lesson.elapsed)
        return True

    def _teach(self) -> tuple[Window, Array, NDArray[np.bool_]]:
        """A lesson from which rest values and noise are learnt; the rest values (n,) before it, and which
        taxels (n,) felt something by these."""
        self._count_repeats()
        total, peak, bend, changed = self.memory[[TOTAL, PEAK, BEND, CHANGED]].astype(np.float64)
        lesson = Window(
            elapsed=self._elapsed,
            mean=total / self._in_lesson,
            peak=peak,
            second_difference=bend / max(self._bends, 1),
            changes=changed / self._in_lesson,
        )
        before = self.baseline.offset.copy()
        raised = lesson.mean - before > self.baseline.threshold
        self.baseline.update(lesson, self._health.healthy)
        return lesson, before, raised

    def _step(self, raised: NDArray[np.bool_], elapsed: float) -> None:
        """What nearly all taxels read for long, and none at the end of its range, is no touch but rest.

        But of a sole, which weight presses all over for as long as the robot stands.
        """
        if self.patch.segment == SOLE:
            return
        settings, sound = self.settings.baseline, self._health.healthy
        all_sound = max(int(np.count_nonzero(sound)), 1)
        nearly_all = int(np.count_nonzero(raised & sound)) >= settings.step_share * all_sound
        self._raised = self._raised + elapsed if nearly_all else 0.0
        if self._raised >= settings.step:
            self._raised = 0.0
            self.rezero()

    def _round(self) -> None:
        """What the loop compares with, in single precision: exact for counts below 2^24."""
        self._values = self._least = None
        self.offset = self.baseline.offset.astype(np.float32)
        self.threshold = self.baseline.threshold.astype(np.float32)

    def _forget(self) -> None:
        self.memory[TOTAL:RAW] = 0.0
        self._in_lesson = self._bends = 0
        self._due = self.settings.baseline.window * (1.0 + self._phase)
        self._phase = self._elapsed = 0.0

    def check(self, values: NDArray[np.generic]) -> None:
        """Raises FrameError unless these can be a frame of the patch."""
        name, expected = self.patch.name, (self.patch.channels,)
        if values.shape != expected:
            raise FrameError(
                f"{name}: frame of shape {values.shape}, expected {expected}, one value per channel"
            )
        if values.dtype.kind not in "uif":
            raise FrameError(
                f"{name}: frame of type {values.dtype}, expected integers or floating point numbers"
            )
