"""No command leaves that would make the robot hit itself: the arms, the body, the head, the other arm.

Each answer leaves a certificate behind: at a posture the links are so far apart, and no servo changes
that by more than its lever. While a motion stays inside what the certificate covers, nothing is computed.
"""

from __future__ import annotations

import numpy as np

from tci.errors import TciError
from tci.frames import Array
from tci.model.clearance import Clearance
from tci.model.description import Robot

MARGIN = 0.005
"""Distance [m] that links keep. Ours: room for the servos' lag and for hulls of reduced meshes."""
SIGHT = 0.1
"""Distances [m] beyond this one are not told apart: they cost time. Ours."""
STRIDE = 0.002
"""Points of a path are looked at where links may have moved this far [m] since the last. Ours."""


class SelfCollision:
    """Looks along a path before it is taken. What it remembers is for speed; no answer depends on it."""

    def __init__(self, robot: Robot, *, margin: float = MARGIN) -> None:
        """Links keep `margin` [m] apart.

        Raises TciError for a margin that is not from 0 to SIGHT, and what Clearance raises.
        """
        if not 0.0 <= margin < SIGHT:
            raise TciError(f"margin {margin} m; valid: 0 to {SIGHT} m")
        self.margin = margin
        self._clearance = Clearance(robot)
        self._posture = np.zeros(len(robot.servos))
        self._distance = -np.inf

    def covers(self, lower: Array, upper: Array) -> bool:
        """Whether every posture between `lower` and `upper` (n_servos,) is known to keep the margin."""
        farthest = np.maximum(np.abs(lower - self._posture), np.abs(upper - self._posture))
        return bool(self._distance - farthest @ self._clearance.levers > self.margin)

    def look(self, position: Array) -> None:
        """Measure at `position` (n_servos,) [rad], so that what lies around it may be covered."""
        self._posture = position
        self._distance = self._clearance.gap(position, within=SIGHT).distance

    def fault(self, path: Array) -> str:
        """Why a motion along `path` (k, n_servos) [rad] must not be made; empty when it may.

        Links that are nearer than the margin where the path begins may go apart, and no nearer.
        """
        here = path[0]
        for point in self._refined(path):
            if self._distance - np.abs(point - self._posture) @ self._clearance.levers > self.margin:
                continue
            self.look(point)
            if self._distance > self.margin:
                continue
            now = self._clearance.gaps(here, within=self.margin)
            then = self._clearance.gaps(point, within=self.margin)
            nearer = then < now
            if nearer.any():
                worst = int(np.argmin(np.where(nearer, then, np.inf)))
                first, second = self._clearance.names(worst)
                return (
                    f"{first} would come {then[worst] * 1e3:.1f} mm near {second}; "
                    f"valid: at least {self.margin * 1e3:g} mm"
                )
        return ""

    def _refined(self, path: Array) -> Array:
        """The path with points between, so that no link moves more than STRIDE from one to the next."""
        steps = np.abs(np.diff(path, axis=0)) @ self._clearance.levers
        counts = np.maximum(1, np.ceil(steps / STRIDE)).astype(int)
        if (counts == 1).all():
            return path
        at = np.concatenate([[0.0], *(i + np.arange(1, n + 1) / n for i, n in enumerate(counts))])
        index = np.minimum(at.astype(int), len(path) - 2)
        share = (at - index)[:, None]
        points: Array = path[index] * (1.0 - share) + path[index + 1] * share
        return points
