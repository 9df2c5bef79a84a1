"""Limits and couplings of servos that move together, and the nearest point within them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.gate.kernels.couplings import MARGIN as MARGIN
from tci.gate.kernels.couplings import find_nearest
from tci.robot.description import Robot

APPROACH = 0.5
"""Fraction of the limits of acceleration and jerk with which velocity-controlled servos slow down before a
limit. Assumed: the remaining fraction covers the time of a change of acceleration."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Limits of n servos and the couplings between them."""

    lower: Array
    """Smallest angles (n,) [rad]."""
    upper: Array
    """Largest angles (n,) [rad]."""
    velocity: Array
    """Speed limits (n,) [rad/s]."""
    acceleration: Array
    """Acceleration limits (n,) [rad/s2]."""
    jerk: Array
    """Jerk limits (n,) [rad/s3]."""
    coupling: Array
    """Coefficients (m, n) of linear inequalities coupling_lower <= coupling @ q <= coupling_upper."""
    coupling_lower: Array
    """Lower bounds (m,) [rad] of the couplings."""
    coupling_upper: Array
    """Upper bounds (m,) [rad] of the couplings."""

    def nearest(self, target: Array, free: NDArray[np.bool_]) -> Array:
        """Returns a point (n,) [rad] within limits and couplings: `target` (n,) [rad] itself, or a point
        close to it.

        Only servos that are `free` (n,) may differ from the target, since the others were not commanded.
        Projects onto each violated half-space in turn (Bregman 1965), and finally onto the limits. If the
        other servos do not allow such a point, the result violates the couplings as little as the limits
        allow.
        """
        point = np.empty(len(target))
        find_nearest(
            self.lower, self.upper, target, self.coupling, self.coupling_lower, self.coupling_upper, free,
            point,
        )  # fmt: skip
        return point

    def inside(self, position: Array) -> Array:
        """Returns `position` (n,) [rad] with each angle outside its limits moved just inside of them."""
        margin = np.minimum(MARGIN, (self.upper - self.lower) / 2)
        nearest = np.clip(position, self.lower + margin, self.upper - margin)
        outside = (position < self.lower) | (position > self.upper)
        inside: Array = np.where(outside, nearest, position)
        return inside

    def inward(self, position: Array, share: float) -> Array:
        """Returns the velocity (n,) [rad/s] with which servos at `position` (n,) [rad] outside their limits
        come to rest just inside of them, at most a `share` of the speed limit; 0 for the other servos."""
        left = self.inside(position) - position
        most = np.minimum(_stopping_speed(np.abs(left), self.acceleration, self.jerk), share * self.velocity)
        inward: Array = np.sign(left) * most
        return inward

    def allowed_velocity(self, position: Array, velocity: Array) -> Array:
        """Returns `velocity` (n,) [rad/s], reduced for servos at `position` (n,) [rad] that could not stop in
        time.

        This only smooths the approach to a limit, because the stop of each step is checked anyway. If servos
        would leave a coupling, all of them slow down by one factor.
        """
        margin = np.minimum(MARGIN, (self.upper - self.lower) / 2)
        room = np.where(velocity > 0.0, self.upper - margin - position, position - self.lower - margin)
        most = _stopping_speed(np.maximum(room, 0.0), self.acceleration, self.jerk)
        velocity = np.clip(velocity, -most, most)
        if not len(self.coupling):
            return velocity
        rate, now = self.coupling @ velocity, self.coupling @ position
        room = np.where(rate > 0.0, self.coupling_upper - MARGIN - now, now - self.coupling_lower - MARGIN)
        size = np.abs(self.coupling)
        most = _stopping_speed(np.maximum(room, 0.0), size @ self.acceleration, size @ self.jerk)
        fast = np.abs(rate) > most
        share = np.min(most[fast] / np.abs(rate[fast]), initial=1.0)
        slow = (size[fast] > 0.0).any(axis=0)
        return np.where(slow, share * velocity, velocity)


def _stopping_speed(room: Array, acceleration: Array, jerk: Array) -> Array:
    """Returns the speed (n,) from which a jerk-limited stop needs at most the distance `room` (n,), with a
    reserve.

    A stop that ramps the acceleration up and down needs v2 / 2a + v a / 2j.
    """
    a, j = APPROACH * acceleration, APPROACH * jerk
    lost = a * a / (2.0 * j)
    speed: Array = np.sqrt(lost * lost + 2.0 * a * room) - lost
    return speed


def bounds_of(robot: Robot, servos: Sequence[int], *, speed_share: float) -> tuple[Bounds, Array]:
    """Returns the bounds of `servos` (n,), whose limits are all known, and of the couplings that contain any
    of them.

    The second result is the coefficients (m, n_servos) of the other servos, by which the couplings shift.
    """
    limits = [robot.servos[servo].limits for servo in servos]
    rows, lowest, highest = robot.coupling_rows
    named = rows[:, list(servos)].any(axis=1)
    terms = np.array(rows[named])
    inside = terms[:, list(servos)]
    terms[:, list(servos)] = 0.0
    bounds = Bounds(
        lower=np.array([limit.lower for limit in limits], dtype=float),
        upper=np.array([limit.upper for limit in limits], dtype=float),
        velocity=speed_share * np.array([limit.velocity for limit in limits], dtype=float),
        acceleration=np.array([limit.acceleration for limit in limits], dtype=float),
        jerk=np.array([limit.jerk for limit in limits], dtype=float),
        coupling=inside,
        coupling_lower=lowest[named],
        coupling_upper=highest[named],
    )
    return bounds, terms
