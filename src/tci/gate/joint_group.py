"""Groups of servos that move together: the servos of a robot part, and of parts that couplings link to this
part.

The fingers of a hand are a separate group, also if they are on the control board of the arm: their motions
take longer, and the arm must not wait for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.bounds import Bounds, bounds_of
from tci.gate.kernels.couplings import shift
from tci.gate.trajectory import Guard, OnlineTrajectory
from tci.gate.way_inside import start_of
from tci.messages import PlatformCommand
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map


@dataclass(frozen=True, slots=True, eq=False)
class JointGroup:
    """The commanded servos of one group, and the trajectory that moves them."""

    servos: list[int]
    """Indices (n,) into `Robot.servos`, in increasing order."""
    index: NDArray[np.intp]
    """`servos` as an array, for indexing."""
    place: dict[int, int]
    """Place in the group of each of its servos."""
    fastest: list[float]
    """Speed limits (n,) [rad/s]."""
    limiter: OnlineTrajectory
    """Trajectory of these servos."""
    bounds: Bounds
    """Bounds of these servos. The bounds of the couplings assume that all servos outside the group are at
    zero; `ends` contains the bounds for the present angles."""
    outside: NDArray[np.float64]
    """Coefficients (m, n_servos) of the servos outside the group, for couplings that contain a servo of the
    group."""
    ends: Array
    """Present lower and upper bounds (2, m) [rad] of the couplings. The bounds depend on the angles of the
    servos outside the group. The trajectory uses this array too, so the array is changed in place."""
    leans: bool
    """True if a coupling of the group also contains a servo outside the group."""

    @property
    def driven(self) -> list[int]:
        """Returns the indices, within the group, of the servos that are driven at a velocity other than
        zero."""
        return np.flatnonzero(np.abs(self.limiter.drive) > 0.0).tolist()  # the comparison is false for NaN

    def aim(self, command: PlatformCommand, sent: Array) -> None:
        """Sets the targets of those servos of a valid command (k,) that belong to the group: the commanded
        angles, or the nearest angles that the bounds allow. Writes the targets into `sent` (k,) [rad]."""
        limiter, values, speeds = self.limiter, command.values.tolist(), command.speed.tolist()
        target, speed = limiter.target.copy(), limiter.speed.copy()
        free = np.zeros(len(target), np.bool_)
        mine = [(row, self.place.get(servo)) for row, servo in enumerate(command.servos.tolist())]
        rows = [(row, place) for row, place in mine if place is not None]
        for row, place in rows:
            target[place], free[place] = values[row], True
            speed[place] = min(speeds[row], self.fastest[place])
        nearest = limiter.bounds.nearest(target, free)
        limiter.aim(nearest, speed)
        aimed = nearest.tolist()
        for row, place in rows:
            sent[row] = aimed[place]

    def look_outside(self, measured: Array) -> None:
        """Shifts the bounds of the couplings by the contribution of the servos outside the group. `measured`
        (n_servos,) [rad] are the angles of all servos."""
        lower, upper = self.bounds.coupling_lower, self.bounds.coupling_upper
        shift(self.outside, measured, lower, upper, self.ends[0], self.ends[1])

    def places(self, servos: Sequence[int]) -> list[int]:
        """Returns, for each of `servos`, its index within the group."""
        return [self.place[servo] for servo in servos]


def make_chain(
    robot: Robot,
    servos: Sequence[int],
    measured: Array,
    *,
    old: JointGroup | None,
    fresh: Sequence[int],
    period: float,
    speed_share: float,
    guard: Guard,
    speed: Array | None = None,
) -> JointGroup:
    """Returns a group of `servos`. Raises CommandError if some servos can't join the motion now; in this case
    `old` is unchanged.

    Args:
        robot: The robot.
        servos: Indices of the servos that the group moves.
        measured: Angles (n_servos,) [rad] at which the servos start.
        old: Group that already moves some of the servos. They continue their motion.
        fresh: Servos that start at their measured angle although `old` moves them.
        period: Duration [s] of a step.
        speed_share: Fraction of the speed limits that may be used.
        guard: Checks planned stops.
        speed: Velocities (n_servos,) [rad/s] at which the servos start; by default they start at rest.
    """
    union = sorted(servos)
    bounds, outside = bounds_of(robot, union, speed_share=speed_share)
    known = bounds.lower, bounds.upper, bounds.velocity, bounds.acceleration, bounds.jerk
    if not np.isfinite(known).all():  # the caller has checked this, but NaN would pass all later comparisons
        raise CommandError("a servo without limits can't be moved", code=Code.LIMITS_UNKNOWN)
    ends = np.array([bounds.coupling_lower, bounds.coupling_upper])
    own = replace(bounds, coupling_lower=ends[0], coupling_upper=ends[1])
    limiter = OnlineTrajectory(own, start_of(measured[union], bounds), period, guard=guard)
    chain = JointGroup(
        union, np.array(union), {servo: place for place, servo in enumerate(union)}, bounds.velocity.tolist(),
        limiter, bounds, outside, ends, bool(outside.any()),
    )  # fmt: skip
    chain.look_outside(measured)
    if speed is not None and speed[union].any():
        limiter.start_moving(speed[union])
    if old is not None:
        moving = [servo for servo in union if servo in old.servos and servo not in fresh]
        if moving:
            limiter.take_over(chain.places(moving), old.limiter, old.places(moving))
    return chain


def groups_of(robot: Robot) -> list[int]:
    """Returns, for each servo, the number of its group. Parts that are linked by couplings form one group."""
    fingers = {
        servo: part.name
        for part in robot.parts
        if part.kind == "fingers"
        for servo in joint_map(robot, part.name).servos.tolist()
    }
    parts = [(servo.robot_part, fingers.get(servo.index)) for servo in robot.servos]
    groups = {part: i for i, part in enumerate(dict.fromkeys(parts))}
    for coupling in robot.couplings:
        tied = {groups[parts[servo]] for servo in coupling.servos}
        groups = {part: min(tied) if group in tied else group for part, group in groups.items()}
    return [groups[part] for part in parts]
