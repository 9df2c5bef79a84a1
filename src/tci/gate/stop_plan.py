"""Jerk-limited stops of servos that move together. Before a state is sent, the stop from this state is
planned.

Each servo stops as soon as it can, independently of the others. A compiled loop computes the three phases of
the stop (`kernels.stops`), to save time: a stop is planned and checked in every period. The library ruckig
would plan equal stops, but more slowly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.gate.bounds import Bounds
from tci.gate.kernels.stops import Limits, empty_stop, follow_stop, plan_stop
from tci.messages.frames import Array

LONGEST_STOP = 512
"""Largest number of periods of a stop near the limit of a coupling; a longer stop is not permitted there.
This number bounds the computing time, since such a stop is checked period by period. Assumed: a stop from
full speed takes a tenth of this number."""
TURN = 1e-3
"""Angle [rad] by which a coupling outside its bounds may move further out during a stop. This tolerance is
necessary because the servos of a coupling come to rest at different times. Assumed: this angle is well below
the backlash of joints."""


class StopTrajectory:
    """The planned motion of n servos in the next period, and a planned stop that begins after this period."""

    __slots__ = ("duration", "here", "span", "way")

    def __init__(self, count: int) -> None:
        self.way = empty_stop(count)
        self.here = self.way.here
        """Angles (n,) [rad] one period before the stop begins."""
        self.span = self.way.span
        """Least and largest angles (2, n) [rad] that the servos pass during the stop."""
        self.duration: float
        """Duration [s] of the stop."""

    def states(self, times: Array) -> Array:
        """Returns angles [rad], velocities [rad/s] and accelerations [rad/s2] (k, 3, n) at `times` (k,) [s]
        after the stop begins."""
        states = np.empty((len(times), 3, len(self.way.end)))
        follow_stop(self.way, times, states)
        return states


class StopPlanner:
    """Plans stops of n servos, and stores the stop that begins at the latest state that was sent."""

    def __init__(self, bounds: Bounds, position: Array, period: float) -> None:
        """Starts at rest at `position` (n,) [rad]. One step of the motion takes `period` [s]."""
        count = len(position)
        self._period = period
        self._bounds = bounds
        self._limits = Limits(*np.array([bounds.lower, bounds.upper, bounds.acceleration, bounds.jerk]))
        self._checked = self._limits, bounds.coupling, bounds.coupling_lower, bounds.coupling_upper
        self._kept, self.planned = StopTrajectory(count), StopTrajectory(count)
        self._since = np.zeros(1)
        self.outside: bool
        """True if the state from which the latest stop was planned is outside the limits."""
        state = np.zeros((3, count))
        state[0] = position
        self.plan(state, state[0])
        self.keep()

    def set_limits(self, acceleration: Array, jerk: Array) -> None:
        """Sets the limits `acceleration` (n,) [rad/s2] and `jerk` (n,) [rad/s3] of later plans."""
        self._limits.acceleration[:], self._limits.jerk[:] = acceleration, jerk

    def plan(self, state: Array, here: Array) -> bool:
        """Plans the stop from `state` (3, n): angles, velocities and accelerations one step after the angles
        `here` (n,) [rad]. Does not change the stored stop.

        Returns True if the planned stop keeps the couplings and stays inside the limits, or no farther
        outside than `here`.
        """
        stop = self.planned
        inside, keeps, self.outside, stop.duration = plan_stop(state, here, *self._checked, stop.way)
        # The check of the box around the stop is quick, and sufficient while no coupling is near.
        return inside and (keeps or self._keeps_couplings(stop))

    def _keeps_couplings(self, stop: StopTrajectory) -> bool:
        """Returns True if a planned stop keeps the couplings (limits of weighted sums of angles) in each of
        its periods."""
        bounds, period = self._bounds, self._period
        if stop.duration > LONGEST_STOP * period:
            return False
        points = stop.states(np.arange(0.0, stop.duration + period, period))[:, 0]
        values = np.vstack([stop.here, points]) @ bounds.coupling.T
        lower, upper = bounds.coupling_lower, bounds.coupling_upper
        outside = np.maximum(np.maximum(lower - values, values - upper), 0.0)
        # A coupling that is inside its bounds must stay inside. A coupling outside its bounds may move out
        # again by at most TURN, and never farther out than at `here`.
        least = np.minimum.accumulate(outside, axis=0)
        most = np.minimum(np.where(least > 0.0, least + TURN, 0.0), outside[0])
        return bool(np.all(outside <= most))

    def keep(self) -> None:
        """Stores the stop that was planned last as the stop from the present state."""
        self._kept, self.planned = self.planned, self._kept
        self._since[0] = 0.0

    def step(self) -> tuple[Array, bool]:
        """Takes a step of the stored stop. Returns angles, velocities and accelerations (3, n), and True if
        the stop has ended."""
        self._since += self._period
        state: Array = self._kept.states(self._since)[0]
        rests = bool(self._since[0] >= self._kept.duration)
        if rests:
            state[1:] = 0.0
        return state, rests

    @property
    def span(self) -> Array:
        """Least and largest angles (2, n) [rad] that the servos pass while they brake according to the stored
        stop."""
        return self._kept.span

    @property
    def begun(self) -> bool:
        """True if at least one step of the stored stop was taken."""
        return bool(self._since[0] > 0.0)

    @property
    def end(self) -> Array:
        """Angles (n,) [rad] at which the stored stop comes to rest."""
        return self._kept.way.end.copy()

    @property
    def remaining(self) -> float:
        """Remaining time [s] of the stored stop."""
        return max(self._kept.duration - float(self._since[0]), 0.0)

    def time_of(self, places: Sequence[int]) -> float:
        """Remaining time [s] in which the servos at `places` come to rest according to the stored stop."""
        way = self._kept.way
        phases = np.array([way.ramp, way.plateau, way.release])[:, list(places)]
        longest = float(phases.sum(axis=0).max(initial=0.0))
        return max(longest - float(self._since[0]), 0.0)

    def ahead(self, times: Array) -> Array:
        """Returns the angles (k, n) [rad] that the n servos will have at `times` (k,) [s] from now, if they
        continue the stop that `keep` stored."""
        return self._kept.states(self._since + times)[:, 0]
