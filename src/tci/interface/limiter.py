"""Jerk-limited motion of the servos that move together, one step per control period (ruckig)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from ruckig import (
    ControlInterface,
    InputParameter,
    OutputParameter,
    Result,
    Ruckig,
    Synchronization,
    Trajectory,
)

from tci.frames import Array

MARGIN = 1e-6
"""Targets stay this far [rad] inside position limits and couplings, for ruckig's own rounding."""
CREEP = 0.1
"""Share of the speed limit at which a servo that starts outside its limits moves inward. Ours."""
_SAMPLES = np.linspace(0.125, 1.0, 8)
"""Where along a stop its path is checked."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """What n servos may do together."""

    lower: Array
    """Smallest angles (n,) [rad]."""
    upper: Array
    """Largest angles (n,) [rad]."""
    velocity: Array
    """(n,) [rad/s]"""
    acceleration: Array
    """(n,) [rad/s2]"""
    jerk: Array
    """(n,) [rad/s3]"""
    coupling: Array
    """Coefficients (m, n) of linear inequalities coupling_lower <= coupling @ q <= coupling_upper."""
    coupling_lower: Array
    """(m,) [rad]"""
    coupling_upper: Array
    """(m,) [rad]"""

    def nearest(self, target: Array) -> Array:
        """A point inside limits and couplings: `target` (n,) [rad] itself, or one close to it.

        Projects onto each violated half-space in turn (Bregman 1965), last onto the limits.
        """
        lower, upper = self.lower + MARGIN, self.upper - MARGIN
        point = np.clip(target, lower, upper)
        for _ in range(100):
            moved = False
            for row, low, high in zip(self.coupling, self.coupling_lower, self.coupling_upper, strict=True):
                value = row @ point
                wanted = min(max(value, low + MARGIN), high - MARGIN)
                if wanted != value:
                    point = np.clip(point + row * (wanted - value) / (row @ row), lower, upper)
                    moved = abs(wanted - row @ point) > 1e-9 or moved
            if not moved:
                break
        return point


class Limiter:
    """Moves n servos towards a target within their bounds; the state it hands out can always stop."""

    def __init__(self, bounds: Bounds, position: Array, period: float) -> None:
        """Starts at rest at the measured `position` (n,) [rad]; one step lasts `period` [s]."""
        count = len(position)
        self.bounds = bounds
        self.target = np.array(position)
        """Where it is going (n,) [rad]."""
        self._stopping = False
        self._otg = Ruckig(count, period)
        self._stopper = Ruckig(count)
        self._input, self._stop = InputParameter(count), InputParameter(count)
        self._output, self._path = OutputParameter(count), Trajectory(count)
        for parameter in (self._input, self._stop):
            parameter.current_position = list(position)
            parameter.max_acceleration = list(bounds.acceleration)
            parameter.max_jerk = list(bounds.jerk)
            parameter.max_velocity = list(bounds.velocity)
            parameter.synchronization = Synchronization.Time
        # Velocity control to zero is the jerk-limited stop; each servo stops as soon as it can.
        self._stop.control_interface = ControlInterface.Velocity
        self._stop.synchronization = Synchronization.No
        self._stop.target_velocity = [0.0] * count
        self._speed = np.array(bounds.velocity)
        self._resting = True

    @property
    def state(self) -> tuple[Array, Array, Array]:
        """Position [rad], velocity [rad/s], acceleration [rad/s2] that were handed out last, each (n,)."""
        i = self._input
        return np.array(i.current_position), np.array(i.current_velocity), np.array(i.current_acceleration)

    def take_over(
        self, servos: Sequence[int], state: tuple[Array, Array, Array], target: Array, speed: Array
    ) -> None:
        """Continue the motion of `servos` (indices here) from another limiter's state."""
        for name, values in zip(
            ("current_position", "current_velocity", "current_acceleration"), state, strict=True
        ):
            merged = list(getattr(self._input, name))
            for index, value in zip(servos, values, strict=True):
                merged[index] = float(value)
            setattr(self._input, name, merged)
        self.target[list(servos)] = target
        self._speed[list(servos)] = speed
        self._resting = False

    @property
    def speed(self) -> Array:
        """Speed limit (n,) [rad/s] of the present motion."""
        return self._speed

    def aim(self, target: Array, speed: Array) -> None:
        """Go to `target` (n,) [rad], which must be inside the bounds, at most at `speed` (n,) [rad/s]."""
        self.target = target
        self._speed = np.minimum(speed, self.bounds.velocity)
        self._stopping = False
        self._resting = False

    def halt(self) -> None:
        """Stop as fast as the bounds allow and stay there: the old target is forgotten at once."""
        if not self._stopping:
            self._plan_stop(*self.state)
            self.target = np.array(self._path.at_time(self._path.duration)[0])
        self._stopping = True
        self._resting = False

    def step(self) -> Array:
        """Positions (n,) [rad] one period later."""
        if self._resting:
            return np.array(self._input.current_position)
        stopped = (self._stopping or not self._advance()) and self._brake()
        self._output.pass_to_input(self._input)
        position = np.array(self._input.current_position)
        if self._stopping and stopped:
            self.target = position
            self._input.current_velocity = self._input.current_acceleration = [0.0] * len(position)
            self._resting = True
        return position

    def _advance(self) -> bool:
        """Compute a step to the target; false when a stop from there would leave the bounds."""
        here = np.array(self._input.current_position)
        outside = (here < self.bounds.lower) | (here > self.bounds.upper)
        self._input.control_interface = ControlInterface.Position
        self._input.synchronization = Synchronization.Time
        self._input.max_velocity = list(self._speed * (CREEP if outside.any() else 1.0))
        self._input.target_position = list(self.target)
        self._input.target_velocity = [0.0] * len(here)
        result = self._otg.update(self._input, self._output)
        if result not in (Result.Working, Result.Finished):
            return False
        if not self._can_stop(here):
            return False
        self._resting = result == Result.Finished
        return True

    def _can_stop(self, here: Array) -> bool:
        """Whether the stop from the state in `_output` stays in bounds, or at least moves inward."""
        output = self._output
        if not self._plan_stop(output.new_position, output.new_velocity, output.new_acceleration):
            return False
        duration = self._path.duration
        points = np.array(
            [self._output.new_position, *(self._path.at_time(t)[0] for t in _SAMPLES * duration)]
        )
        bounds = self.bounds
        inside = np.all(points >= np.minimum(bounds.lower, here)) and np.all(
            points <= np.maximum(bounds.upper, here)
        )
        if not inside or not len(bounds.coupling):
            return bool(inside)
        values, now = points @ bounds.coupling.T, bounds.coupling @ here
        return bool(
            np.all(values >= np.minimum(bounds.coupling_lower, now))
            and np.all(values <= np.maximum(bounds.coupling_upper, now))
        )

    def _plan_stop(self, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> bool:
        """Compute the jerk-limited stop from a state into `_path`; whether there is one."""
        self._stop.current_position = list(np.asarray(position))
        self._stop.current_velocity = list(np.asarray(velocity))
        self._stop.current_acceleration = list(np.asarray(acceleration))
        return self._stopper.calculate(self._stop, self._path) in (Result.Working, Result.Finished)

    def _brake(self) -> bool:
        """Compute a step of the jerk-limited stop; whether it stands still afterwards."""
        self._input.control_interface = ControlInterface.Velocity
        self._input.synchronization = Synchronization.No
        self._input.max_velocity = list(self.bounds.velocity)
        self._input.target_velocity = [0.0] * len(self.target)
        return bool(self._otg.update(self._input, self._output) == Result.Finished)
