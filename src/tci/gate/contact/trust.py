"""Whether joint torques that come over a wire may tell of contact."""

from __future__ import annotations

import numpy as np

SHOWS, EXPECTED = 1.0, 0.5
"""Time [s] for which joints must have moved, and fraction of what counts that they must not have come to,
until torques count over a wire: some robots tell currents, and some plan their own motion."""
GAP, SETTLES = 3.0, 0.2
"""Multiple of the usual time between readings that is a gap, and time [s] after one for which torques tell
nothing over a wire: what waited behind it is older than it says."""
LONGEST = 0.02
"""Longest time [s] between two readings that counts whole as motion."""


class Trust:
    """Counts for how long torques bore what the robot's own motion explains, and looks for gaps."""

    def __init__(self, *, known: bool) -> None:
        """`known`: torques are what they seem, and it is known when joints accelerate."""
        self._known, self._shown = known, np.inf if known else 0.0  # for how long [s] motion showed it
        self._usual, self._stamp, self._gap = np.inf, np.nan, -np.inf  # between readings, and when last [s]
        self._passed = 0.0

    def forget(self) -> None:
        """After the clock went back: what motion showed stays."""
        self._stamp, self._gap = np.nan, -np.inf

    def read(self, stamp: float) -> None:
        """Notes when a reading was measured [s]."""
        self._passed, self._stamp = stamp - self._stamp, stamp
        if self._passed > GAP * self._usual:
            self._gap = stamp
        if self._passed > 0.0:
            self._usual = self._passed if self._usual == np.inf else 0.9 * self._usual + 0.1 * self._passed

    def show(self, most: float, *, moves: bool) -> None:
        """Notes by which multiple of what counts torques changed at most since joints `moves`, or not."""
        if most > 1.0:
            self._shown = 0.0
        elif moves and most < EXPECTED:
            self._shown += min(self._passed, LONGEST)

    @property
    def regular(self) -> bool:
        """Readings came as usual for a while."""
        return self._known or self._stamp - self._gap > SETTLES

    @property
    def earned(self) -> bool:
        """Motion has shown that torques are what they seem."""
        return self._shown >= SHOWS
