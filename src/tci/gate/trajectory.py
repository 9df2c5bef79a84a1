"""Jerk-limited motion of servos that move together, one step per control period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np

from tci.errors import CommandError
from tci.gate.bounds import MARGIN, Bounds
from tci.gate.motion_planner import MotionPlanner
from tci.gate.stop_plan import StopPlanner, StopTrajectory
from tci.gate.way_inside import OUTSIDE, STILL, UNPLANNED, creeping, sags, was_there
from tci.messages.frames import Array
from tci.reasons import Code, Reason

LEAST_SHARE = 1e-6
"""In a straight motion, the limits of each servo are proportional to its distance from the target. A distance
below this fraction of the longest distance is replaced by this fraction, because ruckig needs limits above 0.
"""
Guard = Callable[[StopTrajectory], Reason | None]
"""Function that checks a planned stop before the state at its beginning is sent. Returns the reason to refuse
the stop, or None."""


class Phase(Enum):
    """What a trajectory does. At any time it is in exactly one of these phases."""

    RESTS = "rests"
    """Nothing moves until the next command."""
    GOES = "goes"
    """The servos move to their targets, or at their velocities."""
    STOPS = "stops"
    """All targets are dropped, and the servos brake."""
    RETURNS = "returns"
    """All targets are dropped. Servos outside their limits move back inside, all others brake."""


class OnlineTrajectory:
    """Moves n servos within their bounds, each towards a target or at a velocity.

    Before the trajectory returns a state, it plans a stop from this state and checks the stop against limits
    and couplings. Each state must have a valid stop, a motion that brakes to rest. If the next state towards
    the target has no valid stop, or if no motion to the target is found, the trajectory brakes for one
    period, and tries again in the next period. If the servos come to rest in this way, they continue in a
    straight line to the target, because a line between two points inside limits and couplings stays inside.
    """

    def __init__(
        self, bounds: Bounds, position: Array, period: float, *, guard: Guard = lambda stop: None
    ) -> None:
        """Starts at rest at the measured `position` (n,) [rad]; one step lasts `period` [s].

        `guard` checks each planned stop, which is the motion that would bring the servos to rest. If `guard`
        refuses a planned stop, the servos stop as if `halt` was called, and `ended` contains the reason.
        """
        count = len(position)
        self.bounds, self._period = bounds, period
        self._guard = guard
        self.ended: Reason | None
        """Reason for which the function `guard` ended the motion in the latest step; None if `guard` did not
        end it."""
        self.target: Array = bounds.inside(position)
        """Targets (n,) [rad], always inside the limits."""
        self.speed: Array = bounds.velocity.copy()
        """Largest speeds (n,) [rad/s] on the way to the targets."""
        self.drive: Array = np.full(count, np.nan)
        """Velocity (n,) [rad/s] at which each servo is driven; NaN for a servo that moves to a target."""
        self.drives: bool
        """True if any servo is driven at a velocity."""
        self._hindrance: Reason
        self._begin()
        self._phase = Phase.RESTS
        self.found, self.measured = np.array(position), position
        """Measured angles (n,) [rad]: when the servos came under command, and now."""
        self._led = False  # True if the latest state is a result of ruckig's present plan for these servos
        self._straight, self._together = False, True
        self._planner = MotionPlanner(count, period)
        self._planner.set_limits(bounds.acceleration, bounds.jerk)
        self._stopper = StopPlanner(bounds, position, period)
        self.whole_state: Array
        """Latest position [rad], velocity [rad/s] and acceleration [rad/s2] as one array (3, n)."""
        self.position: Array
        """Latest position (n,) [rad] on the trajectory, the first row of `whole_state`."""
        self.outside: bool
        """True if a servo is outside its limits. The caller must then keep `measured` up to date."""
        self._set_state(np.array([position, np.zeros(count), np.zeros(count)]))
        self._set_interfaces()

    @property
    def state(self) -> tuple[Array, Array, Array]:
        """Latest position [rad], velocity [rad/s] and acceleration [rad/s2], each (n,)."""
        position, velocity, acceleration = self.whole_state
        return position, velocity, acceleration

    @property
    def span(self) -> Array:
        """Least and largest angle (2, n) [rad] that each servo reaches during a stop from the latest
        state."""
        return self._stopper.span

    @property
    def rests(self) -> bool:
        """True if nothing moves until a new command, so that steps can be omitted."""
        return self._phase is Phase.RESTS and not self.drives

    def start_moving(self, velocity: Array) -> None:
        """Starts at `velocity` (n,) [rad/s] instead of at rest, for servos that move when they come under
        command. A velocity from which the servos could not stop within their bounds is reduced; they start at
        rest if the stop is refused even so."""
        fastest = np.clip(velocity, -self.bounds.velocity, self.bounds.velocity)
        allowed = self.bounds.allowed_velocity(self.position, fastest, self._period)
        state = np.array([self.position, allowed, np.zeros(len(allowed))])
        if not self._stopper.plan(state, self.position) or self._guard(self._stopper.planned):
            return
        self._stopper.keep()
        self._set_state(state)
        self.target[:] = self.bounds.inside(self._stopper.end)

    def take_over(self, here: Sequence[int], other: OnlineTrajectory, there: Sequence[int]) -> None:
        """Continues the motion of some servos of the trajectory `other`. The indices of these servos are
        `there` in `other`, and `here` in this trajectory.

        Raises CommandError if no allowed stop is found from the state of these servos. In this case, continue
        with `other`.
        """
        places, others = list(here), list(there)
        state = np.array(self.state)
        state[:, places] = np.array(other.state)[:, others]
        self._set_state(state)
        if not self._stopper.plan(state, self.position):
            raise CommandError(
                "these servos can't join the motion now: they would leave their limits if they stopped; "
                "valid: ask again later"
            )
        if fault := self._guard(self._stopper.planned):
            raise CommandError(f"these servos can't join the motion now: {fault}", code=fault.code)
        self._stopper.keep()
        self.target[places] = other.target[others]
        self.speed[places] = other.speed[others]
        self.drive[places] = other.drive[others]
        self.found[places] = other.found[others]
        self._set_interfaces()
        self._phase = Phase.GOES

    def aim(self, target: Array, speed: Array, *, together: bool = True) -> None:
        """Sets the `target` (n,) [rad], which the servos approach at `speed` (n,) [rad/s] at most. Target and
        speed must be inside the bounds. All servos arrive at the same time if `together`, else each as soon
        as it can.

        Servos that are driven at a velocity continue at this velocity.
        """
        self.target[:], self.speed[:] = target, speed
        if together is not self._together:
            self._together = together
            self._set_interfaces()
        if self._straight:
            self._set_straight(not self.whole_state[1].any())
        self._begin()

    def drive_at(self, places: Sequence[int], velocity: Array) -> None:
        """Drives servos at `velocity` (k,) [rad/s], within the speed limit, until the next call.

        If the velocity of a servo is NaN, the servo is no longer driven: it comes to rest and keeps its
        position. A servo outside its limits moves inward, whatever velocity is requested.
        """
        self.drive[places] = velocity
        rest = np.where(np.isnan(self.drive), self._stopper.end, self.position)
        self.target[places] = self.bounds.inside(rest)[places]
        self._set_interfaces()
        self._begin()

    def _begin(self) -> None:
        """Prepares for a new command: ends a halt, and permits servos outside their limits to try again to
        move back inside."""
        self._phase = Phase.GOES
        self._told: Code | None = None
        self._barred: Reason | None = None  # why the way inside is not tried until the next command

    def halt(self) -> None:
        """Drops all commanded targets and velocities, and brings all servos to rest as fast as the bounds
        allow."""
        if self._phase in (Phase.RESTS, Phase.GOES):
            self.target[:] = self.bounds.inside(self._stopper.end)
            self.drive[self._driven] = 0.0
        if self._phase is not Phase.RESTS:
            self._phase = Phase.STOPS

    @property
    def remaining(self) -> float:
        """Time [s] that a stop from the latest state takes until all servos are at rest."""
        return 0.0 if self._phase is Phase.RESTS else self._stopper.remaining

    def stops_in(self, places: Sequence[int]) -> float:
        """Time [s] in which the servos at `places` come to rest if they stop now."""
        return self._stopper.time_of(places)

    def stop_at(self, times: Array) -> Array:
        """Returns the positions (k, n) [rad] that the servos would have at `times` (k,) [s] from now if they
        stopped now."""
        if self._phase is Phase.RESTS:
            return np.tile(self.position, (len(times), 1))
        return self._stopper.ahead(times)

    def ahead(self, time: float) -> Array:
        """Returns the positions (n,) [rad] that the servos will have after `time` [s] if no new command
        arrives."""
        if self._phase is Phase.RESTS:
            return self.position
        if self._phase is Phase.GOES and self._led and not self._stopper.begun:
            return self._planner.ahead(time)
        ahead: Array = self._stopper.ahead(np.array([time]))[0]
        return ahead

    def step(self, *, blind: bool = False) -> Array:
        """Moves by one period, and returns the new positions (n,) [rad]. Servos on their way brake for this
        period if `blind`: newer data is overdue, and nobody sees what more speed would do."""
        self.ended = None
        moved = self._phase is Phase.RESTS or (self._barred is not None and self._waits)
        moved = moved or (self._phase is Phase.GOES and not blind and self._advance())
        moved = moved or (self._phase is Phase.RETURNS and self._return_inside())
        if not moved:
            self._brake()
        return self.position

    @property
    def _waits(self) -> bool:
        """True if servos are outside their limits and their motion back inside was refused, for example
        because of a self-collision. No servo then moves until the next command."""
        if self.drives or self._phase is Phase.STOPS:
            return False
        return not (self.whole_state[1].any() or self._sags)

    @property
    def _sags(self) -> bool:
        """True if a servo outside its limits has sagged farther outside since it came under command. The
        trajectory then leads the servo back to the angle at which it came under command."""
        return sags(self.position, self.bounds, self.found, self.measured)

    def _advance(self) -> bool:
        """Tries to take a step towards the targets. Returns True if the step was taken; False if not, for
        example because the servos would leave their limits if they stopped after it.

        If servos outside their limits can't move back inside, the other servos move without them. If `guard`,
        the function that checks each planned stop, refuses their motion too, all targets are dropped, and
        only the return inside is tried.
        """
        if self._barred and not self.drives:  # the other servos are at rest
            return self._return_inside()
        self._planner.set_targets(self.target, self._creeping if self.outside else self._most)
        back = self._back() if self.outside else None
        if self.drives:
            self._set_velocities(back, inward=True)
        taken, fault = (False, self._barred) if self._barred and back is not None else self._try()
        if not taken and back is not None and (fault or self.drives or self._straight):
            others = np.where(back != 0.0, self.position, self.target)
            self._planner.set_targets(others, self._creeping)
            if self.drives:
                self._set_velocities(back, inward=False)
            here, hindrance = self.position, self._hindrance
            taken, again = self._try()
            if taken and not np.any(self.position != here):  # the other servos are at rest
                self._return_inside()
            fault = fault or again or (hindrance if taken else None)
        if fault and not (taken and fault.code is self._told):  # the end of all targets is always reported
            self.ended = fault
        self._told = None if fault is None else fault.code
        if fault and not taken and not self._together:  # near the body, on the straight way
            self._together, self.ended = True, None
            self._set_interfaces()
            return False
        if fault and not taken:
            self.halt()
            self._phase = Phase.RETURNS if self.outside else Phase.STOPS
        return taken

    @property
    def _creeping(self) -> Array:
        """Reduced speed limit (n,) [rad/s] of the servos, which applies while one of them is outside its
        limits."""
        return creeping(self._most, straight=self._straight)

    def _back(self) -> Array:
        """Returns the velocity (n,) [rad/s] with which servos outside their limits move inward; 0 for all
        other servos."""
        return self.bounds.inward(self.position, self._creeping, self._period)

    def _set_velocities(self, back: Array | None, *, inward: bool) -> None:
        """Sets the target velocities of driven servos.

        Args:
            back: Velocity (n,) [rad/s] with which each servo outside its limits moves inward; 0 for a servo
                inside its limits. None if all servos are inside.
            inward: True: driven servos outside their limits move inward at `back`. False: they stop.
        """
        allowed = self.bounds.allowed_velocity(self.position, np.nan_to_num(self.drive), self._period)
        if back is not None:
            allowed = np.where(self._driven & (back != 0.0), back if inward else 0.0, allowed)
        self._driving = bool(allowed.any())
        self._planner.set_velocity(allowed)

    def _return_inside(self) -> bool:
        """Takes a step in which servos outside their limits move inward and all others stop. Returns False,
        and takes no step, if no servo is outside or the step is refused.

        If the step is refused while all servos are at rest, it is not tried again until the next command.
        Until then, only servos that have sagged farther outside move: back to the angles at which they came
        under command.
        """
        dropped = self._phase is Phase.RETURNS
        self._set_straight(False)
        back, rests = self._back(), bool(np.abs(self.whole_state[1]).max() <= STILL)
        if not back.any() or (self._barred and not self._sags):
            return False
        self._planner.set_driven(np.ones(len(back), np.bool_))
        self._planner.set_velocity(back)
        taken, fault = self._try(back)
        if not taken and rests and self._barred is None and (fault or self._hindrance is OUTSIDE):
            self._barred = fault or OUTSIDE
        self._set_interfaces()
        self._led, self._phase = False, Phase.RETURNS if dropped else Phase.GOES
        return taken

    def _try(self, back: Array | None = None) -> tuple[bool, Reason | None]:
        """Takes the next step of the plan, if the stop after this step is allowed. Returns True if the step
        was taken, and as second result the reason of the guard (the function that checks each planned stop)
        if it refused the step, otherwise None. If only servos outside their limits move, `back` (n,) [rad/s]
        are their velocities.
        """
        here, state = self.position, self._planner.step()
        self._hindrance = UNPLANNED if state is None else OUTSIDE
        if state is None or not self._stopper.plan(state, here):
            return False, None
        stop = self._stopper.planned
        known = back is not None and was_there(back, here, stop.span, self.found, self.measured)
        barred = None if back is None else self._barred
        if not known and (fault := barred or self._guard(stop)):
            return False, fault
        self._planner.take()
        self.whole_state, self.position, self.outside = state, state[0], self._stopper.outside
        self._stopper.keep()
        if self._planner.ended and not (self._driving or self.outside):
            self._phase = Phase.RESTS
        self._led = True
        return True, None

    def _brake(self) -> None:
        """Takes the next step of the stored stop, which was checked when it was planned."""
        state, rests = self._stopper.step()
        self._set_state(state)
        if rests:
            if self._phase is Phase.STOPS or (self._phase is Phase.RETURNS and not self.outside):
                self._phase = Phase.RESTS
            self._set_straight(True)

    def _set_interfaces(self) -> None:
        """Tells the planner for each servo whether the servo moves to a target or at a velocity."""
        self._driven = np.isfinite(self.drive)
        self.drives, self._driving = bool(self._driven.any()), False
        self._planner.set_driven(self._driven, together=self._together)
        self._set_straight(False)

    def _set_straight(self, straight: bool) -> None:
        """Selects whether the motion from the present state, and its stops, follow a straight line. If
        `straight` is True, the servos must be at rest.

        A motion is straight if all limits are proportional to the distances of the servos. (Ruckig's option
        for straight motions, phase synchronisation, fails because rounded states are not exactly on a line.)
        """
        was, self._straight = self._straight, straight and not self.drives
        self._most, acceleration, jerk = self.speed, self.bounds.acceleration, self.bounds.jerk
        if self._straight:
            way = np.abs(self.target - self.position)
            share = np.maximum(way / max(MARGIN, way.max()), LEAST_SHARE)
            most = np.array([self._most, acceleration, jerk])
            self._most, acceleration, jerk = share * (most / share).min(axis=1, keepdims=True)
        elif not was:  # the planner already has these limits
            return
        self._planner.set_limits(acceleration, jerk)
        self._stopper.set_limits(acceleration, jerk)

    def _set_state(self, state: Array) -> None:
        """Sets the present state of the trajectory and of its planner: positions, velocities and
        accelerations (3, n)."""
        self.whole_state, self.position = state, state[0]
        self.outside = bool(((state[0] < self.bounds.lower) | (state[0] > self.bounds.upper)).any())
        self._planner.set_state(state)
