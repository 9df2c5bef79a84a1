"""A slow reference implementation of SelfCollision. Measures the distance of every pair of links unless the
pair is certainly far apart."""

from __future__ import annotations

import numpy as np

from tci.gate.self_collision import MARGIN, STRIDE
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.clearance import Clearance
from tci.robot.description import Robot

SIGHT = 0.1
NOISE = 1e-9
"""Distance [m] up to which links count as at rest relative to each other."""


class Oracle:
    """Checks paths for self-collision."""

    def __init__(self, robot: Robot, *, margin: float = MARGIN) -> None:
        self.margin = margin
        self._clearance = Clearance(robot)
        self._posture = np.zeros(len(robot.servos))
        self._distance = -np.inf

    def look(self, position: Array) -> None:
        """Measures distances at `position` (n_servos,) [rad]. The results may then be used for postures near
        this position."""
        self._posture = position
        self._distance = self._clearance.gap(position, within=SIGHT).distance

    def fault(self, path: Array) -> Reason | None:
        """Returns the reason why a motion along `path` (k, n_servos) [rad] is refused; None if it is
        permitted.

        Links that are closer than the margin at the start may move apart, but not closer together.
        """
        here = path[0]
        for point in self._refined(path):
            if self._distance - np.abs(point - self._posture) @ self._clearance.levers > self.margin:
                continue
            self.look(point)
            if self._distance > self.margin:
                continue
            now, before = self._clearance.gaps(here, within=self.margin), self._seen()
            then, after = self._clearance.gaps(point, within=self.margin), self._seen()
            # MuJoCo's distances between links at rest vary by up to 1e-7 m.
            nearer = (then < now) & (np.abs(after - before).max(axis=1) > NOISE)
            if nearer.any():
                worst = int(np.argmin(np.where(nearer, then, np.inf)))
                first, second = self._clearance.names(worst)
                return Reason(
                    Code.SELF_COLLISION,
                    f"{first} would come {then[worst] * 1e3:.1f} mm near {second}; "
                    f"valid: at least {self.margin * 1e3:g} mm",
                    (first, second),
                )
        return None

    def _seen(self) -> Array:
        """Returns the pose (pairs, 12) [m] of the second geom of each pair, in the frame of the first
        geom."""
        data, (first, second) = self._clearance._data, self._clearance.pairs.T
        R = data.geom_xmat.reshape(-1, 3, 3)
        p_12 = np.einsum("pji,pj->pi", R[first], data.geom_xpos[second] - data.geom_xpos[first])
        R_12 = np.einsum("pji,pjk->pik", R[first], R[second])
        return np.concatenate([p_12, R_12.reshape(-1, 9)], axis=1)

    def _refined(self, path: Array) -> Array:
        """Returns the path with additional points, so that no link moves farther than STRIDE between two
        points."""
        steps = np.abs(np.diff(path, axis=0)) @ self._clearance.levers
        counts = np.maximum(1, np.ceil(steps / STRIDE)).astype(int)
        if (counts == 1).all():
            return path
        at = np.concatenate([[0.0], *(i + np.arange(1, n + 1) / n for i, n in enumerate(counts))])
        index = np.minimum(at.astype(int), len(path) - 2)
        share = (at - index)[:, None]
        points: Array = path[index] * (1.0 - share) + path[index + 1] * share
        return points
