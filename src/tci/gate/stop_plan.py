"""The jerk-limited stop of servos that move together, known before the state where it begins is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization, Trajectory

from tci.frames import Array
from tci.gate.bounds import Bounds
from tci.gate.kernels.couplings import box_keeps
from tci.gate.kernels.stops import stop_stays_inside

LONGEST_STOP = 512
"""Periods of a stop beside a coupling that are looked at one by one; a longer stop is not risked there."""
TURN = 1e-3
"""A coupling that is outside its bounds may go outwards this far [rad] while its servos come to a stop, since
they do not rest at the same moment. Ours."""


class StopTrajectory(NamedTuple):
    """A planned stop, and the step to where it begins."""

    here: Array
    """Angles (n,) [rad] before that step."""
    span: Array
    """Least and largest angles (2, n) [rad] of the stop."""
    way: Trajectory
    """The stop."""


class StopPlanner:
    """Plans stops of n servos, and keeps the one that begins at the state that was handed out."""

    def __init__(self, bounds: Bounds, position: Array, period: float) -> None:
        """At rest at `position` (n,) [rad]; one step lasts `period` [s]."""
        count = len(position)
        self._period = period
        self._otg, self._input = Ruckig(count), InputParameter(count)
        # Velocity control to zero is the jerk-limited stop; each servo stops as soon as it can.
        self._input.control_interface = ControlInterface.Velocity
        self._input.synchronization = Synchronization.No
        self._input.current_position = list(position)
        self._input.target_velocity = [0.0] * count
        self._input.max_velocity = list(bounds.velocity)
        self.set_limits(bounds.acceleration, bounds.jerk)
        self._way, self._planned = Trajectory(count), Trajectory(count)
        self._otg.calculate(self._input, self._way)
        self._since = 0.0
        self.span = np.array([position, position])
        """Least and largest angles (2, n) [rad] of the stop that is kept."""

    def set_limits(self, acceleration: Array, jerk: Array) -> None:
        """Plan with `acceleration` (n,) [rad/s2] and `jerk` (n,) [rad/s3] from now on."""
        self._jerk = jerk
        self._input.max_acceleration, self._input.max_jerk = acceleration.tolist(), jerk.tolist()

    def plan(self, state: Array, here: Array, bounds: Bounds) -> tuple[bool, StopTrajectory]:
        """The stop from a `state` (3, n), one step from `here` (n,) [rad]. The one that is kept stays so.

        First: whether it stays inside the limits, or outside no farther than `here`. Raises RuckigError when
        there is none.
        """
        i, span = self._input, np.empty((2, len(here)))
        i.current_position, i.current_velocity, i.current_acceleration = state.tolist()
        self._otg.calculate(i, self._planned)
        end = np.array(self._planned.at_time(self._planned.duration)[0])
        inside = stop_stays_inside(state, end, self._jerk, here, bounds.lower, bounds.upper, span)
        return inside, StopTrajectory(here, span, self._planned)

    def keeps_couplings(self, stop: StopTrajectory, bounds: Bounds) -> bool:
        """Whether a planned stop keeps the couplings."""
        lower, upper = bounds.coupling_lower, bounds.coupling_upper
        # The box around the stop is quick to check, and enough while no coupling is near.
        if box_keeps(stop.span, bounds.coupling, lower, upper):
            return True
        duration = stop.way.duration
        if duration > LONGEST_STOP * self._period:
            return False
        times = np.arange(0.0, duration + self._period, self._period)
        points = np.array([stop.way.at_time(time)[0] for time in times])
        values = np.vstack([stop.here, points]) @ bounds.coupling.T
        outside = np.maximum(np.maximum(lower - values, values - upper), 0.0)
        # What came inside does not leave again; outside it turns back only a little, and never beyond `here`.
        least = np.minimum.accumulate(outside, axis=0)
        most = np.minimum(np.where(least > 0.0, least + TURN, 0.0), outside[0])
        return bool(np.all(outside <= most))

    def keep(self, stop: StopTrajectory) -> None:
        """The stop that was planned last is the one to take from the present state."""
        self._way, self._planned = stop.way, self._way
        self.span = stop.span
        self._since = 0.0

    def step(self) -> tuple[Array, bool]:
        """Take a step: angles, velocities, accelerations (3, n) then, and whether the stop is at its end."""
        self._since += self._period
        state = np.array(self._way.at_time(self._since))
        rests = self._since >= self._way.duration
        if rests:
            state[1:] = 0.0
        return state, rests

    @property
    def begun(self) -> bool:
        """Whether steps of the stop were taken."""
        return self._since > 0.0

    @property
    def end(self) -> Array:
        """Angles (n,) [rad] where the stop comes to rest."""
        return np.array(self._way.at_time(self._way.duration)[0])

    @property
    def remaining(self) -> float:
        """Time [s] that is left of the stop."""
        return max(float(self._way.duration) - self._since, 0.0)

    def ahead(self, times: Array) -> Array:
        """Angles (k, n) [rad] on the stop at `times` (k,) [s] from now."""
        return np.array([self._way.at_time(time)[0] for time in (self._since + times).tolist()])
