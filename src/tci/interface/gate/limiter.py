"""Jerk-limited motion of the servos that move together, one step per control period (ruckig)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

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
from tci.interface.gate.bounds import MARGIN, Bounds
from tci.interface.kernels.stops import is_outside, stop_stays_inside
from tci.interface.kernels.targets import straight_limits

CREEP = 0.1
"""Share of the speed limit at which a servo that starts outside its limits moves inward. Ours."""
LONGEST_STOP = 512
"""Periods of a stop beside a coupling that are looked at one by one; a longer stop is not risked there."""
TURN = 1e-3
"""A coupling that is outside its bounds may go outwards this far [rad] while its servos come to a stop, since
they do not rest at the same moment. Ours."""
LEAST_SHARE = 1e-6
"""Least share of the longest way of a straight motion that is told from none; ruckig needs limits above 0."""


class Stop(NamedTuple):
    """A planned stop, and the step to where it begins."""

    here: Array
    """Angles (n,) [rad] before that step."""
    span: Array
    """Least and largest angles (2, n) [rad] of the stop."""
    way: Trajectory
    """The stop."""


Guard = Callable[[Stop], str]
"""Looks at a stop before the state where it begins is handed out: why it must not be; empty when it may."""


class Limiter:
    """Moves n servos within their bounds: each towards a target, or at a velocity.

    The state it hands out always has a stop, already planned and checked against limits and couplings.
    When the next state towards the target has none, or ruckig finds no way, it takes a step of that
    stop instead, and tries again in the next period. A motion that came to rest so goes on in a straight
    line, since a line between two points inside limits and couplings stays inside.
    """

    def __init__(
        self, bounds: Bounds, position: Array, period: float, *, guard: Guard = lambda stop: ""
    ) -> None:
        """Starts at rest at the measured `position` (n,) [rad]; one step lasts `period` [s].

        A stop that `guard` does not let pass ends the motion as `halt` does; `ended` tells why.
        """
        count = len(position)
        self.bounds = bounds
        self._guard = guard
        self.ended = ""
        """Why the guard ended the motion in the last step that was taken; empty when it did not."""
        self.target = np.array(position)
        """Where it is going (n,) [rad]."""
        self._speed = np.array(bounds.velocity)
        self._drive = np.full(count, np.nan)
        self._period = period
        self._stopping = False
        self._resting = True
        self._asked = self._creeps = True
        self._straight = False
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
        self._span = np.array([position, position])
        self._most = self._jerk = np.zeros(count)
        self._state = np.array([position, np.zeros(count), np.zeros(count)])
        self._since = 0.0
        self._stopper.calculate(self._stop, self._escape)
        self._set_interfaces()

    @property
    def state(self) -> tuple[Array, Array, Array]:
        """Position [rad], velocity [rad/s], acceleration [rad/s2] that were handed out last, each (n,)."""
        position, velocity, acceleration = self._state
        return position, velocity, acceleration

    @property
    def whole_state(self) -> Array:
        """The same as one array (3, n), which stays the same object while nothing moves."""
        return self._state

    @property
    def span(self) -> Array:
        """Least and largest angles (2, n) [rad] of the stop from there."""
        return self._span

    @property
    def speed(self) -> Array:
        """Speed limit (n,) [rad/s] of the present motion."""
        return self._speed

    @property
    def drive(self) -> Array:
        """Velocity (n,) [rad/s] at which each servo is driven; NaN for one that goes to a target."""
        return self._drive

    @property
    def drives(self) -> bool:
        """Whether any servo is driven at a velocity."""
        return self._any_driven

    @property
    def rests(self) -> bool:
        """Whether a step would change nothing, until something is asked for."""
        return self._resting and not self._any_driven

    def take_over(self, here: Sequence[int], other: Limiter, there: Sequence[int]) -> None:
        """Continue the motion of some servos, places `there` of another limiter and places `here` of this.

        Raises CommandError when no stop is found from there; then go on with the other one.
        """
        places, others = list(here), list(there)
        state = np.array(self.state)
        state[:, places] = np.array(other.state)[:, others]
        self._set_state(state)
        try:
            span = self._plan_stop(state, self._state[0])[1]
        except RuckigError as error:
            raise CommandError("these servos can't join the motion now; valid: ask again later") from error
        if fault := self._guard(Stop(self._state[0], span, self._candidate)):
            raise CommandError(f"these servos can't join the motion now: {fault}")
        self._accept_stop(span)
        self.target[places] = other.target[others]
        self._speed[places] = other.speed[others]
        self._drive[places] = other.drive[others]
        self._set_interfaces()
        self._resting = False

    def aim(self, target: Array, speed: Array) -> None:
        """Go to `target` (n,) [rad] at most at `speed` (n,) [rad/s]; both must be inside the bounds.

        Servos that are driven at a velocity go on so.
        """
        self.target = np.array(target)
        self._speed = np.array(speed)
        self._set_straight(self._straight and not self._state[1].any())
        self._stopping = False
        self._resting = False

    def drive_at(self, places: Sequence[int], velocity: Array) -> None:
        """Drive servos at `velocity` (k,) [rad/s], within the speed limit, until told otherwise.

        NaN ends that: such a servo, which must be at rest, then stays.
        """
        self._drive[places] = velocity
        self.target[places] = self._state[0][places]
        self._asked = True
        if not np.array_equal(self._driven, np.isfinite(self._drive)):
            self._set_interfaces()
        self._stopping = False
        self._resting = False

    def halt(self) -> None:
        """Stop as fast as the bounds allow and stay there: targets and velocities are forgotten at once."""
        if not self._stopping:
            self.target = np.array(self._escape.at_time(self._escape.duration)[0])
            self._drive[self._driven] = 0.0
            self._asked = True
        self._stopping = True

    @property
    def remaining(self) -> float:
        """Time [s] that the stop from there takes."""
        return 0.0 if self._resting else max(self._escape.duration - self._since, 0.0)

    def stop_at(self, times: Array) -> Array:
        """Where the servos would be (k, n) [rad] at `times` (k,) [s] from now if they stopped now."""
        if self._resting:
            return np.tile(self._state[0], (len(times), 1))
        return np.array([self._escape.at_time(time)[0] for time in (self._since + times).tolist()])

    def ahead(self, time: float) -> Array:
        """Where the servos will be (n,) [rad] in `time` [s] if nothing else is asked for."""
        position: Array = self._state[0]
        if self._stopping or self._since > 0.0:
            return np.array(self._escape.at_time(self._since + time)[0])
        plan = self._output
        return position if self._resting else np.array(plan.trajectory.at_time(plan.time + time)[0])

    def step(self) -> Array:
        """Positions (n,) [rad] one period later."""
        self.ended = ""
        if not self._resting and (self._stopping or not self._advance()):
            self._brake()
        position: Array = self._state[0]
        return position

    def _advance(self) -> bool:
        """Take a step to the target; false, and no step, when a stop from there would leave the bounds."""
        here, output = self._state[0], self._output
        creeps = is_outside(here, self.bounds.lower, self.bounds.upper)
        if self._asked or creeps is not self._creeps:
            self._input.max_velocity = (self._most * (CREEP if creeps else 1.0)).tolist()
            self._input.target_position = self.target.tolist()
            self._asked, self._creeps = False, creeps
        if self._any_driven:
            allowed = self.bounds.allowed_velocity(here, np.nan_to_num(self._drive))
            self._driving = bool(allowed.any())
            outside = (here < self.bounds.lower) | (here > self.bounds.upper)
            self._input.target_velocity = (np.where(outside, CREEP, 1.0) * allowed).tolist()
        try:
            result = self._otg.update(self._input, output)
            numbers = output.new_position, output.new_velocity, output.new_acceleration
            inside, span = self._plan_stop(state := np.array(numbers), here)
        except RuckigError:  # rare states have no synchronised way, mostly where a speed limit falls
            return False
        if not inside or (len(self.bounds.coupling) and not self._keeps_couplings(here, *span)):
            return False
        if fault := self._guard(Stop(here, span, self._candidate)):
            self.ended = fault
            self.halt()
            return False
        output.pass_to_input(self._input)
        self._state = state
        self._accept_stop(span)
        self._resting = result == Result.Finished and not self._driving
        return True

    def _brake(self) -> None:
        """Take a step of the stop that was checked when the present state was handed out."""
        self._since += self._period
        state = np.array(self._escape.at_time(self._since))
        if self._since >= self._escape.duration:
            state[1:] = 0.0
            self._resting = self._stopping
        self._set_state(state)
        if self._since >= self._escape.duration:
            self._set_straight(True)

    def _keeps_couplings(self, here: Array, lowest: Array, highest: Array) -> bool:
        """Whether the planned stop, between `lowest` and `highest` (n,) [rad], keeps the couplings."""
        bounds = self.bounds
        lower, upper = bounds.coupling_lower, bounds.coupling_upper
        # The box around the stop is quick to check, and enough while no coupling is near.
        pull, push = np.maximum(bounds.coupling, 0.0), np.minimum(bounds.coupling, 0.0)
        if np.all((pull @ lowest + push @ highest >= lower) & (pull @ highest + push @ lowest <= upper)):
            return True
        duration = self._candidate.duration
        if duration > LONGEST_STOP * self._period:
            return False
        times = np.arange(0.0, duration + self._period, self._period)
        points = np.array([self._candidate.at_time(time)[0] for time in times])
        values = np.vstack([here, points]) @ bounds.coupling.T
        outside = np.maximum(np.maximum(lower - values, values - upper), 0.0)
        # What came inside does not leave again; outside it turns back only a little, and never beyond `here`.
        least = np.minimum.accumulate(outside, axis=0)
        most = np.minimum(np.where(least > 0.0, least + TURN, 0.0), outside[0])
        return bool(np.all(outside <= most))

    def _plan_stop(self, state: Array, here: Array) -> tuple[bool, Array]:
        """Plan the jerk-limited stop from a `state` (3, n). Raises RuckigError when there is none.

        Returns whether it stays inside the bounds, or outside no farther than `here` (n,), and its span.
        """
        stop = self._stop
        stop.current_position, stop.current_velocity, stop.current_acceleration = state.tolist()
        self._stopper.calculate(stop, self._candidate)
        end, span = np.array(self._candidate.at_time(self._candidate.duration)[0]), np.empty((2, len(here)))
        bounds = self.bounds
        inside = stop_stays_inside(state, end, self._jerk, here, bounds.lower, bounds.upper, span)
        return inside, span

    def _accept_stop(self, span: Array) -> None:
        """The planned stop, which stays in `span`, is the one to take from the present state."""
        self._escape, self._candidate = self._candidate, self._escape
        self._span = span
        self._since = 0.0

    def _set_interfaces(self) -> None:
        """Tell ruckig which servos go to a target, all in the same time, and which keep a velocity."""
        self._driven = np.isfinite(self._drive)
        self._any_driven, self._driving = bool(self._driven.any()), False
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
        was, self._straight = self._straight, straight and not self._any_driven
        self._asked = True
        speed, acceleration, jerk = self._speed, self.bounds.acceleration, self.bounds.jerk
        self._most, self._jerk = speed, jerk
        if self._straight:
            limits = np.empty((3, len(speed)))
            here = self._state[0]
            straight_limits(here, self.target, speed, acceleration, jerk, MARGIN, LEAST_SHARE, limits)
            self._most, acceleration, self._jerk = limits
        elif not was:  # ruckig knows these limits
            return
        for parameter in (self._input, self._stop):
            parameter.max_acceleration, parameter.max_jerk = acceleration.tolist(), self._jerk.tolist()

    def _set_state(self, state: Array) -> None:
        """What is handed out (3, n): positions, velocities, accelerations."""
        self._state = state
        i = self._input
        i.current_position, i.current_velocity, i.current_acceleration = state.tolist()
