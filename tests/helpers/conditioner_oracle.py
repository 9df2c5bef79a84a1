"""Conditioning of one patch in plain NumPy. The compiled loop for all patches must give results that are
equal bit for bit."""

from __future__ import annotations

import math

import numpy as np

from tci.messages.frames import doubles
from tci.skin.baseline import Baseline
from tci.skin.conditioning import ConditioningSettings
from tci.skin.estimation import SATURATED
from tci.skin.health import Health, TaxelHealth
from tci.skin.kernels.baseline import Window
from tci.skin.kernels.condition import GAP
from tci.skin.layout import SkinPatch

SINGLE = np.float32


class OneConditioner:
    """Conditioner of one patch that processes every taxel in every frame."""

    def __init__(self, patch: SkinPatch, settings: ConditioningSettings, phase: float) -> None:
        sensor, count = patch.description.sensor, len(patch.surface.areas)
        sign = np.sign(sensor.pascal_per_count)
        self.full = sensor.highest - sensor.rest if sign > 0 else sensor.rest - sensor.lowest
        pairs = patch.surface.neighbours
        self.patch, self.settings, self.phase = patch, settings, phase
        self.baseline = Baseline(
            count,
            span=sensor.highest - sensor.lowest,
            floor=min(sign * (end - sensor.rest) for end in (sensor.lowest, sensor.highest)),
            noise=sensor.noise,
            neighbours=pairs,
            settings=settings.baseline,
        )
        self.health = TaxelHealth(count, full=self.full, neighbours=pairs, settings=settings.health)
        self.sign, self.due = SINGLE(sign), settings.baseline.window
        self.signal, self.before = np.zeros(count, SINGLE), np.zeros(count, SINGLE)
        self.pressure, self.stamp, self.elapsed, self.raised = np.zeros(count), np.nan, 0.0, 0.0
        self.frames = self.in_window = self.differences = self.dropped = self.saturated = 0
        self.clear()

    def clear(self) -> None:
        self.total, self.peak, self.bend, self.changes = np.zeros((4, len(self.signal)), SINGLE)

    def see(self, values: np.ndarray, stamp: float) -> np.ndarray:
        """Processes the next frame and returns the pressure (n,) [Pa]."""
        self.update()
        gap = 0.0 if math.isnan(self.stamp) else min(max(stamp - self.stamp, 0.0), GAP)
        self.stamp, sensor = stamp, self.patch.description.sensor
        with np.errstate(all="ignore"):
            raw = doubles(values)[self.patch.channels].astype(SINGLE)
        good = (raw >= SINGLE(sensor.lowest)) & (raw <= SINGLE(sensor.highest))
        offset, threshold = self.baseline.offset.astype(SINGLE), self.baseline.threshold.astype(SINGLE)
        signal = np.where(good, self.sign * (np.where(good, raw, SINGLE(0)) - SINGLE(sensor.rest)), offset)
        self.dropped += int((~good).sum())
        self.saturated = int((good & (signal >= SINGLE(self.full))).sum())
        deviation = signal - offset
        if self.frames > 1:
            self.bend += np.abs(signal - SINGLE(2.0) * self.signal + self.before)
        if self.frames > 0:
            self.changes += signal != self.signal
        self.peak = np.maximum(self.peak, np.abs(deviation))
        self.total += signal
        self.before, self.signal = self.signal, signal
        pressure = self.response(deviation.astype(float))
        pressure[~((deviation > 0.0) & (deviation >= threshold) & ~self.health.muted)] = 0.0
        latency = self.settings.latency
        if latency > 0.0 and gap > 0.0:
            share = 1.0 - math.exp(-gap / latency)
            pressure = self.pressure + share * (pressure - self.pressure)
        self.pressure = pressure
        self.differences += self.frames == 2
        self.frames = min(self.frames + 1, 2)
        self.in_window += 1
        self.elapsed += gap
        if self.health.constant:
            self.health.revive(self.changes > 0.0)
        return pressure

    def response(self, counts: np.ndarray) -> np.ndarray:
        nodes = self.patch.nodes
        if not nodes.size:
            return abs(self.patch.description.sensor.pascal_per_count) * counts
        k = np.clip(np.searchsorted(nodes[0], counts), 1, nodes.shape[1] - 1)
        slope = (nodes[1, k] - nodes[1, k - 1]) / (nodes[0, k] - nodes[0, k - 1])
        return nodes[1, k - 1] + slope * (counts - nodes[0, k - 1])

    def update(self) -> None:
        """Updates the estimates from a window that has ended."""
        settings = self.settings.baseline
        if self.elapsed < self.due or self.in_window < settings.frames:
            return
        total, peak, bend, changes = (
            a.astype(float) for a in (self.total, self.peak, self.bend, self.changes)
        )
        count = self.in_window
        window = Window(self.elapsed, total / count, peak, bend / max(self.differences, 1), changes / count)
        before = self.baseline.offset.copy()
        raised = window.mean - before > self.baseline.threshold
        self.baseline.update(window, self.health.healthy)
        self.health.judge(window, self.baseline, before)
        self.forget()
        healthy = self.health.state == Health.HEALTHY
        steps = raised & healthy & (window.mean < SATURATED * self.full)
        if np.count_nonzero(steps) < settings.step_share * max(np.count_nonzero(healthy), 1):
            self.raised = 0.0
        else:
            self.raised += window.elapsed
        if self.raised >= settings.step:
            self.raised = 0.0
            self.rezero()

    def rezero(self) -> None:
        self.baseline.rezero(self.signal.astype(float))
        self.forget()

    def forget(self) -> None:
        self.clear()
        self.in_window = self.differences = 0
        self.due, self.phase = self.settings.baseline.window * (1.0 + self.phase), 0.0
        self.elapsed = 0.0
