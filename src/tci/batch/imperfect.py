"""Imperfections of real skin in many worlds, drawn anew in each world, for policies that must bear them.

Names follow Genesis where it has the imperfection, and `tci.simulation.imperfection` elsewhere."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix

from tci.batch.worlds import Worlds
from tci.errors import TciError
from tci.messages.frames import Array


@dataclass(frozen=True, slots=True)
class Imperfections:
    """By default none. Ranges are of uniform draws, for each taxel of each world."""

    probe_gain_resample_range: tuple[float, float] = (1.0, 1.0)
    """Factor of the force that a taxel reads."""
    dead_taxel_probability: float = 0.0
    """Of a taxel that reads the same at all times."""
    dead_taxel_value_range: tuple[float, float] = (0.0, 0.0)
    """[N], what a dead taxel reads."""
    crosstalk_strength: float = 0.0
    """Fraction of a taxel's force that its neighbours read beside their own, in equal parts."""
    hysteresis: float = 0.0
    """While the force decreases, this fraction of its decrease since its maximum is not seen."""
    creep: float = 0.0
    """Fraction by which the reading rises under a force that lasts."""
    creep_time: float = 10.0
    """[s]"""
    delay: float = 0.0
    """Age [s] of what is read."""

    def __post_init__(self) -> None:
        for name in ("dead_taxel_probability", "crosstalk_strength", "hysteresis", "creep", "delay"):
            most = np.inf if name == "delay" else 1.0
            if not 0.0 <= (value := getattr(self, name)) <= most or value == np.inf:
                raise TciError(f"imperfections: {name} {value}; valid: 0 to {most:g}, finite")
        for name in ("probe_gain_resample_range", "dead_taxel_value_range"):
            low, high = getattr(self, name)
            if not 0.0 <= low <= high < np.inf:
                raise TciError(f"imperfections: {name} {(low, high)}; valid: 0 <= low <= high, finite")
        if not 0.0 < self.creep_time < np.inf:
            raise TciError(f"imperfections: creep_time {self.creep_time} s; valid: above 0, finite")


class ImperfectSkin:
    """What imperfect taxels read in all worlds; `read` after every `advance`."""

    def __init__(self, worlds: Worlds, imperfections: Imperfections, *, seed: int = 0) -> None:
        self._worlds, self._own = worlds, imperfections
        self._chance = np.random.default_rng(seed)
        shape = worlds.count, worlds.scene.taxels
        self.gain, self.dead = np.ones(shape), np.full(shape, np.nan)
        """Factors, and values [N] of dead taxels (N, taxels), NaN for living ones."""
        self._largest, self._crept = np.zeros(shape), np.zeros(shape)
        self._past: deque[tuple[float, Array]] = deque()
        self._time = worlds.time
        graph, count = worlds.scene.body.layout.arrays.graph, shape[1]
        number = np.maximum(np.diff(graph[: count + 1]), 1)
        share = csr_matrix(
            (np.ones(len(graph) - count - 1), graph[count + 1 :], graph[: count + 1] - graph[0]),
            (count, count),
        )
        self._talk = csr_matrix(share.multiply(1.0 / number[:, None]))
        """Row i: the parts of the force on taxel i that its neighbours get."""
        self.reset()

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Draws gains and dead taxels of some worlds, or of all, and forgets their past."""
        ids, own = self._worlds.ids(worlds), self._own
        shape = len(ids), self.gain.shape[1]
        self.gain[ids] = self._chance.uniform(*own.probe_gain_resample_range, shape)
        fixed = self._chance.uniform(*own.dead_taxel_value_range, shape)
        self.dead[ids] = np.where(self._chance.random(shape) < own.dead_taxel_probability, fixed, np.nan)
        self._largest[ids] = self._crept[ids] = 0.0
        for _, frame in self._past:
            frame[ids] = 0.0

    def read(self) -> Array:
        """Forces (N, taxels) [N] that are read now."""
        own, now = self._own, self._worlds.time
        elapsed, self._time = max(now - self._time, 0.0), now
        force = self._worlds.force * self.gain
        if own.crosstalk_strength > 0.0:
            force = force + own.crosstalk_strength * (self._talk.T @ force.T).T
        self._crept += (1.0 - np.exp(-elapsed / own.creep_time)) * (force - self._crept)
        self._largest = np.where(force > 0.0, np.maximum(self._largest, force), 0.0)
        kept = own.hysteresis * np.where(force > 0.0, self._largest - force, 0.0)
        self._past.append((now, force + kept + own.creep * self._crept))
        while len(self._past) > 1 and self._past[1][0] <= now - own.delay + 1e-9:
            self._past.popleft()
        seen = self._past[0][1] if self._past[0][0] <= now - own.delay + 1e-9 else np.zeros_like(force)
        reading: Array = np.where(np.isnan(self.dead), seen, self.dead)
        return reading
