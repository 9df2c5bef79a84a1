"""Streamed set-points: where a commander that sends them one after the other would come to rest.

A gate that went to each set-point itself would arrive there at rest, again and again, and lag behind by the
distance that a stop takes. So it goes where the stream would end if its sender braked now, v^2 / (2 a)
ahead; when nothing more comes, back to the last set-point.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from tci.frames import Array

ENDED = 0.1
"""Silence [s] after which a stream has ended. Ours."""
KEPT = 5
"""Set-points that its speed is taken from. Ours."""


QUICKEST = 0.005
"""Time [s] that counts between two set-points at least: a lead that is too small only lags. Ours."""
SLOWLY = 0.05
"""Share of a new time between set-points in their mean: some that come together are no faster. Ours."""


class SetPoints:
    """The latest set-points of a board's joints [rad]."""

    def __init__(self, velocity: Array, acceleration: Array) -> None:
        """Limits (n,) of the joints [rad/s], [rad/s2]; 0 where there are none."""
        self._velocity = velocity
        self._acceleration = np.where(acceleration > 0.0, acceleration, np.inf)
        self._stream: tuple[list[int], list[tuple[float, Array]], bool] = ([], [], False)
        self._period = 0.0
        # Replaced as a whole: connections and the loop come here from threads of their own.

    def lead(self, joints: Sequence[int], values: Array, now: float | None = None) -> Array:
        """Where to go (k,) for set-points (k,) of these joints [rad] that came in now [s]."""
        now = time.monotonic() if now is None else now
        before, kept, _ = self._stream
        if list(joints) != before or not kept or now - kept[-1][0] > ENDED:
            kept = []
            self._period = 0.0
        if kept:
            gap = now - kept[-1][0]
            self._period += (gap - self._period) * (SLOWLY if self._period else 1.0)
        kept = [*kept[1 - KEPT :], (now, values)]
        speed = self._speed(list(joints), kept)
        ahead: Array = speed * np.abs(speed) / (2.0 * self._acceleration[list(joints)])
        self._stream = list(joints), kept, bool(np.any(ahead != 0.0))
        return values + ahead

    def last(self, now: float | None = None) -> tuple[list[int], Array] | None:
        """The joints and set-points of a stream that has ended ahead of itself; told once."""
        now = time.monotonic() if now is None else now
        joints, kept, ahead = self._stream
        if not ahead or now - kept[-1][0] <= ENDED:
            return None
        self._stream = joints, kept, False
        return joints, kept[-1][1]

    def forget(self) -> None:
        """The robot holds: where the stream would have ended is nobody's wish any more."""
        self._stream = [], [], False

    def _speed(self, joints: list[int], kept: list[tuple[float, Array]]) -> Array:
        """Speed (k,) [rad/s] of the stream by its smallest step, where all go the same way; 0 elsewhere."""
        values = np.array([values for _, values in kept])
        span = kept[-1][0] - kept[0][0]
        if len(kept) < KEPT or span <= 0.0:
            return np.zeros(values.shape[1])
        steps = np.diff(values, axis=0)
        same = np.all(steps > 0.0, axis=0) | np.all(steps < 0.0, axis=0)
        slowest = (
            np.sign(steps[0]) * np.abs(steps).min(axis=0) / max(QUICKEST, self._period, span / len(steps))
        )
        limit = self._velocity[joints]
        return np.where(same, np.clip(slowest, -limit, limit), 0.0)
