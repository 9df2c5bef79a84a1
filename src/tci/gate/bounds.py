"""Limits and couplings of servos that move together. Finds the posture inside the limits and couplings that
is nearest to a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.gate.kernels.couplings import MARGIN as MARGIN
from tci.gate.kernels.couplings import find_nearest
from tci.messages.frames import Array
from tci.robot.description import Robot

APPROACH = 0.5
"""Fraction of the acceleration limit and of the jerk limit that velocity-controlled servos use to slow down
before a position limit. Assumed: the unused fraction is a reserve for the time that a change of acceleration
takes."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Limits of n servos and the couplings between them."""

    lower: Array
    """Smallest angles (n,) [rad] that the servos may have."""
    upper: Array
    """Largest angles (n,) [rad] that the servos may have."""
    velocity: Array
    """Speed limits (n,) [rad/s]."""
    acceleration: Array
    """Acceleration limits (n,) [rad/s2]."""
    jerk: Array
    """Jerk limits (n,) [rad/s3]."""
    coupling: Array
    """Coefficients (m, n) of the couplings: coupling_lower <= coupling @ q <= coupling_upper for angles q."""
    coupling_lower: Array
    """Lower bounds (m,) [rad] of the couplings."""
    coupling_upper: Array
    """Upper bounds (m,) [rad] of the couplings."""

    def nearest(self, target: Array, free: NDArray[np.bool_]) -> Array:
        """Returns a point (n,) [rad] within limits and couplings: `target` (n,) [rad] itself, or a point
        close to it.

        The result differs from the target only for servos that are `free` (n,), since the other servos were
        not commanded. The method projects the target onto each violated half-space in turn (Bregman 1965),
        and finally onto the limits. If the servos that are not free prevent a solution, the result violates
        the couplings as little as the limits allow.
        """
        point = np.empty(len(target))
        find_nearest(
            self.lower, self.upper, target, self.coupling, self.coupling_lower, self.coupling_upper, free,
            point,
        )  # fmt: skip
        return point

    def inside(self, position: Array) -> Array:
        """Returns `position` (n,) [rad]. Each angle outside its limits is replaced by an angle just inside
        them."""
        margin = np.minimum(MARGIN, (self.upper - self.lower) / 2)
        nearest = np.clip(position, self.lower + margin, self.upper - margin)
        outside = (position < self.lower) | (position > self.upper)
        inside: Array = np.where(outside, nearest, position)
        return inside

    def inward(self, position: Array, speed: Array, period: float) -> Array:
        """Returns the velocity (n,) [rad/s] with which servos return into their limits.

        Each servo at a `position` (n,) [rad] outside its limits gets the velocity from which it comes to rest
        just inside the limits, at most `speed` (n,) [rad/s]. All other servos get 0.
        """
        left = self.inside(position) - position
        most = _stopping_speed(np.abs(left), self.acceleration, self.jerk, period)
        inward: Array = np.sign(left) * np.minimum(most, speed)
        return inward

    def allowed_velocity(self, position: Array, velocity: Array, period: float) -> Array:
        """Returns `velocity` (n,) [rad/s], with a reduced value for each servo that could not stop before its
        limit. The servos are at `position` (n,) [rad], and the velocity is that of the next `period` [s].

        The reduction only makes the approach to a limit smooth. Safety does not depend on it: before each
        step, the gate also checks that the servos can still stop. If the servos would leave the bounds of a
        coupling, all servos of this coupling are slowed down by one factor.
        """
        margin = np.minimum(MARGIN, (self.upper - self.lower) / 2)
        room = np.where(velocity > 0.0, self.upper - margin - position, position - self.lower - margin)
        most = _stopping_speed(np.maximum(room, 0.0), self.acceleration, self.jerk, period)
        velocity = np.clip(velocity, -most, most)
        if not len(self.coupling):
            return velocity
        rate, now = self.coupling @ velocity, self.coupling @ position
        room = np.where(rate > 0.0, self.coupling_upper - MARGIN - now, now - self.coupling_lower - MARGIN)
        size = np.abs(self.coupling)
        most = _stopping_speed(np.maximum(room, 0.0), size @ self.acceleration, size @ self.jerk, period)
        fast = np.abs(rate) > most
        share = np.min(most[fast] / np.abs(rate[fast]), initial=1.0)
        slow = (size[fast] > 0.0).any(axis=0)
        return np.where(slow, share * velocity, velocity)


def _stopping_speed(room: Array, acceleration: Array, jerk: Array, period: float) -> Array:
    """Returns the speed (n,) [rad/s] from which a servo can stop within the distance `room` (n,) [rad], with
    a reserve.

    At speed v, a stop with the largest deceleration a and the jerk j needs the distance v^2 / 2a + v a / 2j.
    Before it the servo goes on for two periods, the one that is planned and the next, and for the time a / j
    in which the acceleration ends with which it may have come to v.
    """
    a, j = APPROACH * acceleration, APPROACH * jerk
    lost = a * (1.5 * a / j + 2.0 * period)
    speed: Array = np.sqrt(lost * lost + 2.0 * a * room) - lost
    return speed


def bounds_of(robot: Robot, servos: Sequence[int], *, speed_share: float) -> tuple[Bounds, Array]:
    """Returns the bounds of `servos` (n,), with all m couplings in which one of these servos occurs, and the
    coefficients (m, n_servos) of all other servos in these couplings.

    An unknown limit is NaN. The coefficients are necessary because the angles of the other servos shift the
    bounds of the couplings.
    """
    limits = [robot.servos[servo].limits for servo in servos]
    rows, lowest, highest = robot.coupling_rows
    known = [(one.lower, one.upper, one.velocity, one.acceleration, one.jerk) for one in limits]
    lower, upper, velocity, acceleration, jerk = np.array(known, np.float64).reshape(-1, 5).T.copy()
    named = rows[:, list(servos)].any(axis=1)
    terms = np.array(rows[named])
    inside = terms[:, list(servos)]
    terms[:, list(servos)] = 0.0
    bounds = Bounds(
        lower=lower,
        upper=upper,
        velocity=speed_share * velocity,
        acceleration=acceleration,
        jerk=jerk,
        coupling=inside,
        coupling_lower=lowest[named],
        coupling_upper=highest[named],
    )
    return bounds, terms
