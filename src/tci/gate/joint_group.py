"""Servos that move together: those of a robot part, and of parts that couplings tie to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.gate.bounds import Bounds, bounds_of
from tci.gate.kernels.couplings import shift
from tci.gate.kernels.targets import SPEED, TARGET, take_targets
from tci.gate.trajectory import Guard, OnlineTrajectory
from tci.robot.description import Robot


@dataclass(frozen=True, slots=True, eq=False)
class JointGroup:
    """The servos of one group that are under command, and what moves them."""

    servos: list[int]
    """Indices (n,) into `Robot.servos`, which rise."""
    index: NDArray[np.intp]
    """The same, to pick them from an array."""
    limiter: OnlineTrajectory
    """Moves them."""
    bounds: Bounds
    """What they may do while every servo outside is at zero."""
    outside: NDArray[np.float64]
    """Coefficients (m, n_servos) of servos outside, in the couplings that name one of these."""
    limits: Array
    """Least and largest angles [rad] and speed limits [rad/s] (3, n) in one array."""
    ends: Array
    """Bounds (2, m) of the couplings now, which are those of the limiter: they shift with servos outside."""

    @property
    def driven(self) -> list[int]:
        """Places of the servos that are driven at a velocity other than zero."""
        drive = self.limiter.drive
        if not self.limiter.drives:
            return []
        return np.flatnonzero(np.abs(drive) > 0.0).tolist()  # false for NaN

    def aim(self, servos: NDArray[np.intp], values: Array, speeds: Array, sent: Array) -> float:
        """Aim those of `servos` (k,) that are its own at `values` (k,) [rad] or next to them inside the
        bounds, at most at `speeds` (k,) [rad/s].

        Writes where they are `sent` (k,) [rad], and returns how far that is at most from the values [rad].
        """
        limiter, count = self.limiter, len(self.servos)
        aims = np.empty((3, count))
        aims[TARGET], aims[SPEED] = limiter.target, limiter.speed
        farthest: float = take_targets(
            self.index, servos, values, speeds, self.limits, self.bounds.coupling, self.ends,
            np.empty(count, np.bool_), aims, sent,
        )  # fmt: skip
        limiter.aim(aims[TARGET], aims[SPEED])
        return farthest

    def look_outside(self, measured: Array) -> None:
        """A coupled servo that is not commanded with these counts where it is `measured` (n_servos,) now."""
        if len(self.outside):
            lower, upper = self.bounds.coupling_lower, self.bounds.coupling_upper
            shift(self.outside, measured, lower, upper, self.ends[0], self.ends[1])

    def places(self, servos: Sequence[int]) -> list[int]:
        """Places of some of its servos in the arrays of its limiter."""
        return [self.servos.index(servo) for servo in servos]


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
) -> JointGroup:
    """A chain of `servos`, at rest where they are `measured` (n_servos,) [rad].

    Servos that `old` moves go on as they do there, but for the `fresh` ones. Raises CommandError when
    some can't join the motion now; `old` is then as it was.
    """
    union = sorted(servos)
    bounds, outside = bounds_of(robot, union, speed_share=speed_share)
    ends = np.array([bounds.coupling_lower, bounds.coupling_upper])
    limits = np.array([bounds.lower, bounds.upper, bounds.velocity])
    own = replace(bounds, coupling_lower=ends[0], coupling_upper=ends[1])
    limiter = OnlineTrajectory(own, measured[union], period, guard=guard)
    chain = JointGroup(union, np.array(union, dtype=np.intp), limiter, bounds, outside, limits, ends)
    chain.look_outside(measured)
    if old is not None:
        moving = [servo for servo in union if servo in old.servos and servo not in fresh]
        if moving:
            limiter.take_over(chain.places(moving), old.limiter, old.places(moving))
    return chain


def groups_of(robot: Robot) -> list[int]:
    """The group (n_servos,) of each servo; parts that couplings tie together are one."""
    parts = [servo.robot_part for servo in robot.servos]
    groups = {part: i for i, part in enumerate(dict.fromkeys(parts))}
    for coupling in robot.couplings:
        tied = {groups[parts[servo]] for servo in coupling.servos}
        groups = {part: min(tied) if group in tied else group for part, group in groups.items()}
    return [groups[part] for part in parts]
