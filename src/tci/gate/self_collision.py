"""Prevention of self-collisions: between an arm and the body, the head or the other arm.

Compiled loops compute a lower bound on the distance of each pair of links (`kernels.clearance_bounds`). For
most pairs, this bound shows that the distance is sufficient. For the other pairs, MuJoCo computes the
distance.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tci.errors import TciError
from tci.gate.kernels.clearance_bounds import come_near, follow, stand
from tci.gate.kernels.solids import Solids
from tci.messages.frames import Array
from tci.reasons import Code, Reason, decimals
from tci.robot.clearance import Clearance, without_skin
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.kernels.arrays import Indices
from tci.support.engine import mujoco

MARGIN = 0.005
"""Smallest allowed distance [m] between two links. Assumed: covers the lag of servos and the errors of
simplified meshes."""
WIDEST = 0.1
"""Upper bound [m] on the argument `margin`, the distance that links must keep from each other. Assumed: with
a larger margin, hands could hardly be used near the body."""
SIGHT = 1.0
"""Upper bound [m] on measured distances: this value also stands for every larger distance between two links.
Assumed: no link moves this far in one period."""
STRIDE = 0.002
"""Largest motion [m] of a link between two checked points of a path. Assumed: less than half of MARGIN, the
default distance that links must keep."""
PATIENCE = 16
"""Number of checks from one measurement of the stored distances to the next, if in all these checks the
stored distances do not suffice to exclude a collision. Assumed: one measurement takes as long as a few
checks."""
SPECK = 1e-6
"""Distance [m] between two links below which the direction from one link to the other is only a rounding
error."""


@lru_cache(maxsize=8)
def _solids(robot: Robot) -> Solids:
    """Returns the joints and shapes of a robot, as read-only arrays that all gates of this robot share."""
    return Solids.of(Clearance(robot))


class SelfCollision:
    """Checks a path for self-collision before the robot executes it. The caches of this class only save time:
    they never change a result."""

    def __init__(self, robot: Robot, *, margin: float = MARGIN) -> None:
        """Reads the robot's solids; links must keep `margin` [m] apart.

        Raises TciError if `margin` is negative or at least 0.1 m, or if a joint is not a hinge. Raises
        DescriptionError if the robot has no model, or if a joint is missing in the model.
        """
        if not 0.0 <= margin < WIDEST:
            raise TciError(f"margin {margin} m; valid: 0 to {WIDEST} m")
        self.margin = margin
        self._clearance = Clearance(robot)
        self._model = self._clearance.model
        self._data = mujoco.MjData(self._model)
        s = self._solids = _solids(without_skin(robot))
        self._arrays = (s.path, s.steps, s.sums, s.shapes, s.points, s.poses, s.pairs, s.levers)
        joints, pairs = s.levers.shape
        self._left, self._axis, self._least = np.zeros(pairs, np.int32), np.zeros((pairs, 3)), np.zeros(pairs)
        self._angles, self._frames = np.zeros(joints), np.zeros((joints, 3, 4))
        self._slack, self._asked, self._at = np.zeros(pairs), np.zeros(pairs, np.int32), np.zeros(2, np.int64)
        never = np.full(pairs, -np.inf)
        self._known = (
            np.zeros((joints, pairs)), never, self._axis, self._left, self._slack, self._least,
            np.zeros(pairs), self._frames, self._angles,
        )  # fmt: skip
        self._strides = self._clearance.levers[s.servos]
        self._segment = np.zeros(6)
        self._ends = np.zeros((2, joints))
        self._safe, pause = np.full((2, joints), np.inf), np.zeros(1, np.int64)
        self._fixed = (self._arrays, self._known, s.servos, s.zero, self._safe, pause)
        self._patience = 0
        start = self._of_joints(initial_position(robot))
        self._measure(start, np.arange(pairs, dtype=np.int32), self._axis)

    def keeps_margin(self, box: Array) -> bool:
        """Returns True if all postures between the angles of `box` (2, n_servos) [rad] certainly keep the
        margin.

        False does not mean a collision: in this case, check the path with `fault`. `box` must be a contiguous
        array of floats, because the compiled loop reads it directly.
        """
        count = self._near(box)
        if count and self._patience <= 0:
            self._measure(self._ends.mean(axis=0), self._left[:count].copy(), self._axis)
            count = self._near(box)
            self._patience = PATIENCE
        self._patience = self._patience - 1 if count else 0
        return not count

    def fault(self, path: Array) -> Reason | None:
        """Returns the reason why the robot must not move along `path` (k, n_servos) [rad]; None if this
        motion is allowed.

        Links that are closer than the margin at the start of the path may move apart, but not closer
        together.
        """
        if not (count := self._near(np.array([path.min(axis=0), path.max(axis=0)], np.float64))):
            return None
        way = self._of_joints(path)
        self._at[:] = 0
        while asked := follow(
            self._arrays, self._known, count, way, self._strides, STRIDE, self.margin, self._at, self._asked
        ):
            pairs = self._asked[:asked].copy()
            then = self._measure(self._angles, pairs, self._axis)
            self._slack[pairs] = then - self.margin
            near = then <= self.margin
            if not near.any():
                continue
            pairs, then = pairs[near], then[near]
            self._slack[pairs] = 0.0
            self._least[pairs] = now = np.minimum(self._measure(way[0], pairs), self.margin)
            then = np.minimum(then, self.margin)
            if (then < now).any():
                worst = int(np.argmin(np.where(then < now, then, np.inf)))
                first, second = self._clearance.names(int(pairs[worst]))
                least, comes = self.margin * 1e3, float(then[worst]) * 1e3
                return Reason(
                    Code.SELF_COLLISION,
                    f"{first} would come {comes:.{decimals(comes, least, 1)}f} mm near {second}; "
                    f"valid: at least {least:g} mm",
                    (first, second),
                )
        return None

    def _near(self, box: Array) -> int:
        """Returns the number of pairs of links whose distance may fall below the margin while the servos are
        between the least and largest angles `box` (2, n_servos) [rad]."""
        count: int = come_near(*self._fixed, box, self._ends, self.margin)
        return count

    def _measure(self, angles: Array, pairs: Indices, axis: Array | None = None) -> Array:
        """Measures the distances (m,) [m] of the pairs of links with the indices `pairs` (m,), at the angles
        `angles` (j,) [rad] of the model's joints. Distances above 1 m (SIGHT) count as 1 m. If `axis` (p, 3)
        is given, writes the direction between the two links of each of these pairs into it."""
        s, data, segment = self._solids, self._data, self._segment
        stand(self._arrays, angles, self._frames, data.geom_xpos, data.geom_xmat, s.geoms)
        result = np.empty(len(pairs))
        for index, pair in enumerate(pairs.tolist()):
            one, other = s.geoms[s.pairs[pair]].tolist()
            found = mujoco.mj_geomDistance(self._model, data, one, other, SIGHT, segment)
            result[index] = found
            if axis is not None and SPECK < abs(found) < SIGHT:
                axis[pair] = (segment[3:] - segment[:3]) / found
        return result

    def _of_joints(self, angles: Array) -> Array:
        """Converts angles of the servos (..., n_servos) to angles (..., j) [rad] of the model's joints."""
        found: Array = angles.take(self._solids.servos, -1) - self._solids.zero
        return found
