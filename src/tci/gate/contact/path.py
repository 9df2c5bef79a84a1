"""The path that a group of servos came, and the way back along it."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array

KEPT = 3.0
"""Length [s] of the path that is remembered: more than any way back needs."""
STEP = float(np.deg2rad(0.2))
"""Angle [rad] between two postures of the path."""
FURTHER = float(np.deg2rad(3.0))
"""Angle [rad] of each further way back while the joint is still held."""


class Path:
    """Postures (k,) [rad] of one group, each with the time [s] at which it was measured."""

    def __init__(self) -> None:
        self._postures: deque[tuple[float, Array]] = deque()

    def __bool__(self) -> bool:
        return bool(self._postures)

    def clear(self) -> None:
        self._postures.clear()

    def walk(self, here: Array, stamp: float) -> None:
        """Notes where the joints are."""
        postures = self._postures
        if not postures or np.abs(here - postures[-1][1]).max() > STEP:
            postures.append((stamp, here.copy()))
        while stamp - postures[0][0] > KEPT:
            postures.popleft()
            if not postures:
                postures.append((stamp, here.copy()))

    def back(self, here: Array, before: float, own: NDArray[np.bool_], pull: Array) -> Array:
        """The latest posture from before the time `before` [s] that is `FURTHER` away from `here`: away from
        where joints press, by `pull` (k,) [rad] each, or by the joint with the longest way if none does. Only
        the servos `own` (k,) count. The path is used up to there. Else the posture that is farthest away, or
        here: never nearer to what joints push, so one that somebody pushed off its way stays where it was
        pushed."""
        best, last = self._find(here, before, own, pull)
        self._postures = deque(list(self._postures)[:last])
        yields: Array = np.where(pull > 0.0, np.minimum(best, here), np.maximum(best, here))
        return np.where(pull == 0.0, best, yields)

    def came(self, here: Array, own: NDArray[np.bool_]) -> Array:
        """The way (k,) [rad] from `here` to where the servos `own` (k,) came from."""
        way: Array = self._find(here, np.inf, own, np.zeros(len(here)))[0] - here
        return way

    def _find(self, here: Array, before: float, own: NDArray[np.bool_], pull: Array) -> tuple[Array, int]:
        """Where a way back ends, and its number in the path."""
        path, pulled = list(self._postures), pull.any()
        best, most, last = here.copy(), 0.0, len(path)
        for number in reversed(range(len(path))):
            stamp, posture = path[number]
            way = (posture - here)[own]
            away = float(-(pull[own] @ way) / np.linalg.norm(pull) if pulled else np.abs(way).max())
            if away > most:
                best, most, last = posture, away, number
                if stamp <= before and away >= FURTHER:
                    break
        return best, last
