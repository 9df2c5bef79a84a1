"""Jerk-limited motion of the servos that move together, one step per control period (ruckig)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from ruckig import (
    ControlInterface,
    InputParameter,
    OutputParameter,
    Result,
    Ruckig,
    RuckigError,
    Synchronization,
    Trajectory,
)

from tci.errors import CommandError
from tci.frames import Array
from tci.interface.bounds import MARGIN, Bounds

CREEP = 0.1
"""Share of the speed limit at which a servo that starts outside its limits moves inward. Ours."""
LONGEST_STOP = 512
"""Periods of a stop beside a coupling that are looked at one by one; a longer stop is not risked there."""

LEAST_SHARE = 1e-6
"""Least share of the longest way of a straight motion that is told from none; ruckig needs limits above 0."""


class Guard(Protocol):
    """Looks at a stop before the state from which it would be taken is handed out."""

    def __call__(self, lowest: Array, highest: Array, stop: Trajectory) -> bool:
        """Whether a stop may be taken that stays between `lowest` and `highest` (n,) [rad]."""
        ...


class Limiter:
    """Moves n servos within their bounds: each towards a target, or at a velocity.

    The state it hands out always has a stop, already planned and checked against limits and couplings.
    When the next state towards the target has none, or ruckig finds no way, it takes a step of that
    stop instead, and tries again in the next period. A motion that came to rest so goes on in a straight
    line, since a line between two points inside limits and couplings stays inside.
    """

    def __init__(self, bounds: Bounds, position: Array, period: float, *, guard: Guard | None = None) -> None:
        """Starts at rest at the measured `position` (n,) [rad]; one step lasts `period` [s].

        A stop that `guard` does not let pass ends the motion as `halt` does.
        """
        count = len(position)
        self.bounds = bounds
        self._guard = guard
        self.target = np.array(position)
        """Where it is going (n,) [rad]."""
        self._speed = np.array(bounds.velocity)
        self._drive = np.full(count, np.nan)
        self._period = period
        self._stopping = False
        self._resting = True
        self._otg = Ruckig(count, period)
        self._input, self._output = InputParameter(count), OutputParameter(count)
        self._stopper = Ruckig(count)
        self._stop = InputParameter(count)
        # Velocity control to zero is the jerk-limited stop; each servo stops as soon as it can.
        self._stop.control_interface = ControlInterface.Velocity
        self._stop.synchronization = Synchronization.No
        for parameter in (self._input, self._stop):
            parameter.current_position = list(position)
            parameter.target_velocity = [0.0] * count
            parameter.max_velocity = list(bounds.velocity)
            parameter.max_acceleration = list(bounds.acceleration)
            parameter.max_jerk = list(bounds.jerk)
        self._escape, self._candidate = Trajectory(count), Trajectory(count)
        self._since = 0.0
        self._stopper.calculate(self._stop, self._escape)
        self._set_interfaces()

    @property
    def state(self) -> tuple[Array, Array, Array]:
        """Position [rad], velocity [rad/s], acceleration [rad/s2] that were handed out last, each (n,)."""
        i = self._input
        return np.array(i.current_position), np.array(i.current_velocity), np.array(i.current_acceleration)

    @property
    def speed(self) -> Array:
        """Speed limit (n,) [rad/s] of the present motion."""
        return self._speed

    @property
    def drive(self) -> Array:
        """Velocity (n,) [rad/s] at which each servo is driven; NaN for one that goes to a target."""
        return self._drive

    def take_over(self, here: Sequence[int], other: Limiter, there: Sequence[int]) -> None:
        """Continue the motion of some servos, places `there` of another limiter and places `here` of this.

        Raises CommandError when no stop is found from there; then go on with the other one.
        """
        places, others = list(here), list(there)
        state = self.state
        for values, theirs in zip(state, other.state, strict=True):
            values[places] = theirs[others]
        self._set_state(*(list(values) for values in state))
        try:
            self._plan_stop(*(list(values) for values in state))
        except RuckigError as error:
            raise CommandError("these servos can't join the motion now; valid: ask again later") from error
        self._accept_stop()
        self.target[places] = other.target[others]
        self._speed[places] = other.speed[others]
        self._drive[places] = other.drive[others]
        self._set_interfaces()
        self._resting = False

    def aim(self, target: Array, speed: Array) -> None:
        """Go to `target` (n,) [rad], which must be inside the bounds, at most at `speed` (n,) [rad/s].

        Servos that are driven at a velocity go on so.
        """
        self.target = np.array(target)
        self._speed = np.minimum(speed, self.bounds.velocity)
        self._set_straight(self._straight and not np.any(self._input.current_velocity))
        self._stopping = False
        self._resting = False

    def drive_at(self, places: Sequence[int], velocity: Array) -> None:
        """Drive servos at `velocity` (k,) [rad/s], within the speed limit, until told otherwise.

        NaN ends that: such a servo, which must be at rest, then stays.
        """
        self._drive[places] = velocity
        self.target[places] = np.array(self._input.current_position)[places]
        if not np.array_equal(self._driven, np.isfinite(self._drive)):
            self._set_interfaces()
        self._stopping = False
        self._resting = False

    def halt(self) -> None:
        """Stop as fast as the bounds allow and stay there: targets and velocities are forgotten at once."""
        if not self._stopping:
            self.target = np.array(self._escape.at_time(self._escape.duration)[0])
            self._drive[self._driven] = 0.0
        self._stopping = True

    def stop_at(self, time: float) -> Array:
        """Where the servos would be (n,) [rad] `time` [s] from now if they stopped now."""
        return np.array(self._escape.at_time(self._since + time)[0])

    def step(self) -> Array:
        """Positions (n,) [rad] one period later."""
        if not self._resting and (self._stopping or not self._advance()):
            self._brake()
        return np.array(self._input.current_position)

    def _advance(self) -> bool:
        """Take a step to the target; false, and no step, when a stop from there would leave the bounds."""
        here = np.array(self._input.current_position)
        outside = (here < self.bounds.lower) | (here > self.bounds.upper)
        self._input.max_velocity = list(self._most * (CREEP if outside.any() else 1.0))
        self._input.target_position = list(self.target)
        if self._driven.any():
            allowed = self.bounds.allowed_velocity(here, np.nan_to_num(self._drive))
            self._driving = bool(allowed.any())
            self._input.target_velocity = list(np.where(outside, CREEP, 1.0) * allowed)
        output = self._output
        try:
            result = self._otg.update(self._input, output)
            self._plan_stop(output.new_position, output.new_velocity, output.new_acceleration)
        except RuckigError:  # rare states have no synchronised way, mostly where a speed limit falls
            return False
        if not self._stays_inside(here):
            return False
        output.pass_to_input(self._input)
        self._accept_stop()
        self._resting = result == Result.Finished and not self._driving
        return True

    def _brake(self) -> None:
        """Take a step of the stop that was checked when the present state was handed out."""
        self._since += self._period
        position, velocity, acceleration = self._escape.at_time(self._since)
        if self._since >= self._escape.duration:
            velocity = acceleration = [0.0] * len(position)
            self._resting = self._stopping
        self._set_state(position, velocity, acceleration)
        if self._since >= self._escape.duration:
            self._set_straight(True)

    def _stays_inside(self, here: Array) -> bool:
        """Whether the planned stop stays in bounds, or outside them no farther than `here` (n,) [rad]."""
        bounds = self.bounds
        start, velocity, acceleration = (
            np.array(values)
            for values in (
                self._stop.current_position,
                self._stop.current_velocity,
                self._stop.current_acceleration,
            )
        )
        turn = turning_point(start, velocity, acceleration, np.array(self._stop.max_jerk))
        end = np.array(self._candidate.at_time(self._candidate.duration)[0])
        lowest = np.minimum(np.minimum(start, turn), end)
        highest = np.maximum(np.maximum(start, turn), end)
        if not np.all(
            (lowest >= np.minimum(bounds.lower, here)) & (highest <= np.maximum(bounds.upper, here))
        ):
            return False
        if not self._keeps_couplings(here, lowest, highest):
            return False
        if self._guard is not None and not self._guard(lowest, highest, self._candidate):
            self.halt()
            return False
        return True

    def _keeps_couplings(self, here: Array, lowest: Array, highest: Array) -> bool:
        """Whether the planned stop, between `lowest` and `highest` (n,) [rad], keeps the couplings."""
        bounds = self.bounds
        if not len(bounds.coupling):
            return True
        now = bounds.coupling @ here
        lower, upper = np.minimum(bounds.coupling_lower, now), np.maximum(bounds.coupling_upper, now)
        # The box around the stop is quick to check, and enough while no coupling is near.
        pull, push = np.maximum(bounds.coupling, 0.0), np.minimum(bounds.coupling, 0.0)
        if np.all((pull @ lowest + push @ highest >= lower) & (pull @ highest + push @ lowest <= upper)):
            return True
        duration = self._candidate.duration
        if duration > LONGEST_STOP * self._period:
            return False
        times = np.arange(0.0, duration + self._period, self._period)
        points = np.array([self._candidate.at_time(time)[0] for time in times])
        values = points @ bounds.coupling.T
        return bool(np.all((values >= lower) & (values <= upper)))

    def _plan_stop(self, position: list[float], velocity: list[float], acceleration: list[float]) -> None:
        """Plan the jerk-limited stop from a state. Raises RuckigError when there is none."""
        self._stop.current_position = position
        self._stop.current_velocity = velocity
        self._stop.current_acceleration = acceleration
        self._stopper.calculate(self._stop, self._candidate)

    def _accept_stop(self) -> None:
        """The planned stop is the one to take from the present state."""
        self._escape, self._candidate = self._candidate, self._escape
        self._since = 0.0

    def _set_interfaces(self) -> None:
        """Tell ruckig which servos go to a target, all in the same time, and which keep a velocity."""
        self._driven = np.isfinite(self._drive)
        self._driving = False
        self._input.target_velocity = [0.0] * len(self._drive)
        self._input.per_dof_control_interface = [
            ControlInterface.Velocity if driven else ControlInterface.Position for driven in self._driven
        ]
        self._input.per_dof_synchronization = [
            Synchronization.No if driven else Synchronization.Time for driven in self._driven
        ]
        self._set_straight(False)

    def _set_straight(self, straight: bool) -> None:
        """Whether the motion from here, which must be at rest then, and its stops follow a straight line.

        They do where all limits are in the ratio of the ways. (ruckig's phase synchronisation is not for
        this: it gives up where states are only nearly on a line, as rounding leaves them.)
        """
        self._straight = straight and not self._driven.any()
        limits = [self._speed, self.bounds.acceleration, self.bounds.jerk]
        if self._straight:
            way = np.abs(self.target - np.array(self._input.current_position))
            share = np.maximum(way / max(float(way.max()), MARGIN), LEAST_SHARE)
            limits = [share * np.min(limit / share) for limit in limits]
        self._most, acceleration, jerk = limits
        for parameter in (self._input, self._stop):
            parameter.max_acceleration, parameter.max_jerk = list(acceleration), list(jerk)

    def _set_state(self, position: list[float], velocity: list[float], acceleration: list[float]) -> None:
        self._input.current_position = position
        self._input.current_velocity = velocity
        self._input.current_acceleration = acceleration


def turning_point(position: Array, velocity: Array, acceleration: Array, jerk: Array) -> Array:
    """Where (n,) [rad] servos turn back while they stop, or their `position` where they do not.

    A servo turns back when its acceleration alone takes it through zero velocity, even while `jerk`
    (n,) [rad/s3] takes the acceleration away as fast as it may. With start and end this gives all
    that a stop passes through. (`Trajectory.position_extrema` is wrong for a stop: it counts 0 in.)
    """
    square = acceleration**2 - 2.0 * jerk * np.abs(velocity)
    turns = (velocity * acceleration < 0.0) & (square > 0.0)
    time = np.where(turns, (np.abs(acceleration) - np.sqrt(np.maximum(square, 0.0))) / jerk, 0.0)
    away = -np.sign(acceleration) * jerk
    return position + time * (velocity + time * (acceleration / 2.0 + time * away / 6.0))
