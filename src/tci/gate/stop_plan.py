"""Jerk-limited stops of servos that move together. Each stop is planned before the state at its beginning is
sent.

Each servo stops as soon as it can, independently of the others. `kernels.stops` computes the three phases of
each stop, since a stop is planned and checked in every period; ruckig's velocity control would plan equal
stops.
"""

from __future__ import annotations

import numpy as np

from tci.frames import Array
from tci.gate.bounds import Bounds
from tci.gate.kernels.stops import (
    ACCELERATION,
    END,
    HERE,
    JERK,
    LEAST,
    MOST,
    STOP_ROWS,
    follow_stop,
    plan_stop,
)

LONGEST_STOP = 512
"""Largest number of periods for which a stop near a coupling is checked period by period. Assumed: a stop
from full speed takes a tenth of this; a longer stop near a coupling is not permitted."""
TURN = 1e-3
"""Angle [rad] by which a coupling outside its bounds may move further out during a stop, since its servos do
not come to rest at the same time. Assumed: well below the backlash of joints."""


class StopTrajectory:
    """A planned stop of n servos, and the step to its beginning."""

    __slots__ = ("duration", "here", "span", "way")

    def __init__(self, count: int) -> None:
        self.way = np.zeros((STOP_ROWS, count))
        """The stop, in the rows of `kernels.stops`."""
        self.here = self.way[HERE]
        """Angles (n,) [rad] before that step."""
        self.span = self.way[LEAST : MOST + 1]
        """Least and largest angles (2, n) [rad] of the stop."""
        self.duration = 0.0
        """Duration [s] of the stop."""

    def states(self, times: Array) -> Array:
        """Returns angles, velocities and accelerations (k, 3, n) at `times` (k,) [s] after it begins."""
        states = np.empty((len(times), 3, self.way.shape[1]))
        follow_stop(self.way, times, states)
        return states


class StopPlanner:
    """Plans stops of n servos, and keeps the stop that begins at the latest state that was sent."""

    def __init__(self, bounds: Bounds, position: Array, period: float) -> None:
        """Starts at rest at `position` (n,) [rad]; one step lasts `period` [s]."""
        count = len(position)
        self._period = period
        self._bounds = bounds
        self._limits = np.array([bounds.lower, bounds.upper, bounds.acceleration, bounds.jerk])
        self._kept, self.planned = StopTrajectory(count), StopTrajectory(count)
        self._since = np.zeros(1)
        self.outside = False
        """True if the state of the latest plan is outside the limits."""
        state = np.zeros((3, count))
        state[0] = position
        self.plan(state, state[0])
        self.keep()

    def set_limits(self, acceleration: Array, jerk: Array) -> None:
        """Sets `acceleration` (n,) [rad/s2] and `jerk` (n,) [rad/s3] for later plans."""
        self._limits[ACCELERATION], self._limits[JERK] = acceleration, jerk

    def plan(self, state: Array, here: Array) -> bool:
        """Plans the stop from a `state` (3, n), one step after `here` (n,) [rad]; the kept stop is unchanged.

        Returns True if it stays inside the limits, or no farther outside than `here`, and keeps the
        couplings.
        """
        stop, bounds = self.planned, self._bounds
        inside, keeps, self.outside, stop.duration = plan_stop(
            state, here, self._limits, bounds.coupling, bounds.coupling_lower, bounds.coupling_upper, stop.way
        )
        # The box around the stop is quick to check, and suffices while no coupling is near.
        return inside and (keeps or self._keeps_couplings(stop))

    def _keeps_couplings(self, stop: StopTrajectory) -> bool:
        """Checks period by period that a planned stop keeps the couplings."""
        bounds, period = self._bounds, self._period
        if stop.duration > LONGEST_STOP * period:
            return False
        points = stop.states(np.arange(0.0, stop.duration + period, period))[:, 0]
        values = np.vstack([stop.here, points]) @ bounds.coupling.T
        lower, upper = bounds.coupling_lower, bounds.coupling_upper
        outside = np.maximum(np.maximum(lower - values, values - upper), 0.0)
        # Once inside it stays inside; outside it turns back only a little, and never beyond `here`.
        least = np.minimum.accumulate(outside, axis=0)
        most = np.minimum(np.where(least > 0.0, least + TURN, 0.0), outside[0])
        return bool(np.all(outside <= most))

    def keep(self) -> None:
        """Keeps the stop that was planned last, as the one from the present state."""
        self._kept, self.planned = self.planned, self._kept
        self._since[0] = 0.0

    def step(self) -> tuple[Array, bool]:
        """Takes a step of the kept stop. Returns angles, velocities, accelerations (3, n), and True at its
        end."""
        self._since += self._period
        state: Array = self._kept.states(self._since)[0]
        rests = bool(self._since[0] >= self._kept.duration)
        if rests:
            state[1:] = 0.0
        return state, rests

    @property
    def span(self) -> Array:
        """Least and largest angles (2, n) [rad] of the kept stop."""
        return self._kept.span

    @property
    def begun(self) -> bool:
        """True once steps of the stop were taken."""
        return bool(self._since[0] > 0.0)

    @property
    def end(self) -> Array:
        """Angles (n,) [rad] at which the stop comes to rest."""
        end: Array = self._kept.way[END].copy()
        return end

    @property
    def remaining(self) -> float:
        """Remaining time [s] of the stop."""
        return max(self._kept.duration - float(self._since[0]), 0.0)

    def ahead(self, times: Array) -> Array:
        """Returns the angles (k, n) [rad] on the stop at `times` (k,) [s] from now."""
        return self._kept.states(self._since + times)[:, 0]
