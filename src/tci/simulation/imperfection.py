"""Imperfections of a real sensor: cross-talk, creep, hysteresis and warming."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array
from tci.skin.surfaces import Surface


@dataclass(frozen=True, slots=True)
class Imperfection:
    """Deviations of a simulated sensor from an ideal sensor. By default all are 0.

    No magnitudes of these deviations are published for any of the robots' skins. `usual()` returns assumed
    magnitudes.
    """

    cross_talk: float = 0.0
    """Fraction of a taxel's signal that appears on the neighbouring taxels. Each neighbour receives an equal
    part."""
    creep: float = 0.0
    """Fraction by which a signal increases under a constant load. After the load, this additional signal
    decreases slowly."""
    creep_time: float = 10.0
    """Time constant [s] of creep."""
    hysteresis: float = 0.0
    """Strength h of the hysteresis: while the load decreases, the signal is s + h (m - s). In this formula, s
    is the ideal signal, and m the largest signal of the touch. After the end of the load the signal has no
    hysteresis."""
    gradient: float = 0.0
    """Difference [counts] between the rest values at the two ends of a patch, after one end has become warm.
    """
    gradient_time: float = 600.0
    """Time constant [s] with which one end of a patch becomes warm."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value, time = getattr(self, field.name), field.name.endswith("_time")
            most = 1.0 if field.name in ("cross_talk", "creep", "hysteresis") else np.inf
            if not (0.0 < value < np.inf if time else abs(value) < most and (value >= 0.0 or most > 1.0)):
                valid = "above 0" if time else "0 to below 1" if most == 1.0 else "finite"
                raise TciError(f"imperfection: {field.name} {value}; valid: {valid}")

    @staticmethod
    def usual() -> Imperfection:
        """Returns assumed magnitudes for soft foam over capacitive taxels.

        Each fraction is 5 %, and `gradient` is 10 counts.
        """
        return Imperfection(cross_talk=0.05, creep=0.05, hysteresis=0.05, gradient=10.0)


class ImperfectTaxels:
    """Computes the signals of one patch with a sensor's imperfections.

    The object contains the state of creep and hysteresis.
    """

    def __init__(self, surface: Surface, imperfection: Imperfection) -> None:
        self._own, count = imperfection, len(surface.areas)
        one, other = surface.neighbours.T
        self._one, self._other = np.concatenate([one, other]), np.concatenate([other, one])
        self._number = np.maximum(np.bincount(self._one, minlength=count), 1)
        along = surface.positions - surface.positions.mean(axis=0)
        along = along @ np.linalg.svd(along, full_matrices=False)[2][0] if count else np.zeros(0)
        self._warm = (along - along.min(initial=0.0)) / max(float(np.ptp(along)) if count else 0.0, 1e-9)
        self._crept, self._largest = np.zeros(count), np.zeros(count)
        self._last: float | None = None

    def signal(self, pressed: Array, now: float) -> Array:
        """Returns the deviations (n,) [counts] from rest at time `now` [s].

        `pressed` (n,) [counts] are the deviations of an ideal sensor. Times must not decrease.
        """
        own = self._own
        elapsed = 0.0 if self._last is None else max(now - self._last, 0.0)
        self._last = now
        to_each = own.cross_talk * pressed / self._number
        loaded = pressed + np.bincount(self._other, to_each[self._one], len(pressed))
        self._crept += (1.0 - np.exp(-elapsed / own.creep_time)) * (loaded - self._crept)
        self._largest = np.where(loaded > 0.0, np.maximum(self._largest, loaded), 0.0)
        kept = own.hysteresis * np.where(loaded > 0.0, self._largest - loaded, 0.0)
        warmth = own.gradient * (1.0 - np.exp(-now / own.gradient_time)) * self._warm
        result: Array = loaded + own.creep * self._crept + kept + warmth
        return result
