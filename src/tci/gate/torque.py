"""Torque mode: limits for servos that are driven by torques, without position control.

In torque mode there is no position reference that could be kept within limits. Therefore the limits use the
measured motion and the masses of the links. These limits need recent joint data. When newer data is overdue,
no torque drives a joint any more. Braking torques decrease to zero: with old data, a braking torque would
still act after the joint has come to rest, and drive the joint backwards.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError, DescriptionError
from tci.gate.bounds import APPROACH, MARGIN
from tci.gate.kernels.torques import Answers, Limits, Measured, Memory, Times, limit_torques
from tci.gate.way_inside import CREEP, QUICK
from tci.messages import Mode
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.clearance import without_skin
from tci.robot.description import Robot
from tci.robot.dynamics import inertia_range
from tci.robot.joint_calibration import Tool

EARLY = 0.01
"""Fraction of a period below which a remainder is neglected, when the age of data is converted to a number of
periods. Assumed: larger than rounding errors."""
REMEMBERED = 0.1
"""Time [s] for which past torques are stored: longer than the readings from which torques are computed are
old."""
NUDGE = float(np.deg2rad(1.0))
"""Angle [rad] by which a full torque is looked ahead of for self-collision."""
UNDERWAY = 2.0
"""Periods that a torque needs from the gate to the motor. Robots need 1 to 3; with 1 true speeds are 5 %
higher."""


class TorqueLimiter:
    """Limits the torques of all servos of a robot that are in torque mode."""

    def __init__(self, robot: Robot, period: float, *, speed_share: float, push: float) -> None:
        self._robot = robot
        self._inertia, self._missing = np.full(len(robot.servos), np.nan), ""
        self._period = period
        self._share, self._push = speed_share, push
        count = len(robot.servos)
        self._memory = Memory(*np.zeros((5, count)))
        self._answers = Answers(*np.zeros((10, count)))
        self._pushed = deque([np.zeros(count)], maxlen=1 + math.ceil(REMEMBERED / period))
        self._told = np.zeros(count, dtype=bool)
        self._halts = np.zeros(count)
        self._clock, self._taken = 0.0, -np.inf
        self.servos: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        """Indices (k,) of the servos in torque mode."""
        self.load({})

    def set_servos(self, servos: Sequence[int]) -> None:
        """Sets which servos are in torque mode: `servos`, and no others. All limits of these servos must be
        known. New servos start at zero torque."""
        fresh = [servo for servo in servos if servo not in self.servos]
        for kept in (*self._memory, *self._answers):
            kept[fresh] = 0.0
        self.servos = np.array(sorted(servos), dtype=np.intp)
        limits = [self._robot.servos[servo].limits for servo in self.servos]
        rows = [(x.lower, x.upper, x.velocity, x.acceleration, x.torque) for x in limits]
        lower, upper, velocity, acceleration, torque = np.array(rows, np.float64).reshape(-1, 5).T.copy()
        velocity *= self._share
        creep = CREEP * np.minimum(velocity, QUICK)
        self._limits = Limits(
            lower + MARGIN,
            upper - MARGIN,
            velocity,
            creep,
            acceleration,
            APPROACH * acceleration,
            torque,
            self._inertia[self.servos],
        )
        self._trust = np.zeros(len(self.servos))

    def load(self, tools: Mapping[str, Tool]) -> None:
        """Sets what links carry in addition to their own masses, by the name of the link."""
        try:
            if any(Mode.TORQUE in servo.modes for servo in self._robot.servos):
                self._inertia = inertia_range(without_skin(self._robot), tuple(tools.items())).least
        except DescriptionError as error:
            self._missing = "; ".join(fault.message for fault in error.faults)
        self.set_servos(self.servos.tolist())

    def check(self, servos: NDArray[np.intp]) -> None:
        """Raises CommandError if the inertia that one of the servos moves is unknown."""
        for servo in servos[~np.isfinite(self._inertia[servos])].tolist():
            why = self._missing or "its joint is not in the model"
            raise CommandError(
                f"{self._robot.servos[servo].name} has no torque mode: {why}; "
                "valid: a <model> with the masses of all links, from which its speed is limited",
                code=Code.LIMITS_UNKNOWN,
            )

    def ask(self, servos: NDArray[np.intp], torque: Array) -> Array:
        """Sets the commanded `torque` (k,) [N m] of `servos`. Returns this torque, clipped to each servo's
        torque limit."""
        limit = np.array([self._robot.servos[servo].limits.torque for servo in servos])
        wanted: Array = np.clip(torque, -limit, limit)
        self._memory.wanted[servos] = wanted
        return wanted

    def relax(self, servos: NDArray[np.intp] | EllipsisType = ...) -> None:
        """Sets the commanded torque of some servos, or of all servos, to zero. A servo that moves too fast
        towards a limit is still braked."""
        self._memory.wanted[servos] = 0.0

    @property
    def unanswered(self) -> Array:
        """Torques (k,) [N m] that were added without an answer: readings of angle and velocity repeated
        exactly. 0 for servos whose readings answer."""
        unanswered: Array = self._answers.unanswered[self.servos]
        return unanswered

    def withheld(self) -> list[int]:
        """Servos that from now on get no more torque, since their readings repeat exactly."""
        withheld = self._answers.withheld > 0.0
        fresh = np.flatnonzero(withheld & ~self._told).tolist()
        self._told = withheld
        return fresh

    def forget(self) -> None:
        """Trusts encoders that did not answer again."""
        for kept in self._answers:
            kept[:] = 0.0

    def halt(self, servos: NDArray[np.intp] | EllipsisType = ...) -> None:
        """Sets the commanded torque of some servos, or of all servos, to zero. The next call of `step` brakes
        any motion of these servos."""
        self.relax(servos)
        self._halts[servos] = 1.0

    def ways(self, velocity: Array, age: float) -> Array:
        """Angles (k,) [rad] to which the motion of the servos leads from where they were measured `age` [s]
        ago: until a brake takes effect, until it has ended the motion, and a little where torques point."""
        limits, own = self._limits, self.servos
        late = age + (1.0 + UNDERWAY) * self._period
        speed = np.nan_to_num(velocity[own])
        turned: Array = self._memory.wanted[own] / limits.torque
        return speed * late + speed * np.abs(speed) / (2.0 * limits.approach) + NUDGE * turned

    def go_back(self, servos: NDArray[np.intp], ways: Array) -> None:
        """In the next step brakes `servos` and takes them back from where their `ways` (k,) [rad] lead."""
        self.relax(servos)
        self._halts[servos] = np.where(ways == 0.0, 1.0, 2.0 * np.sign(ways))

    def step(
        self,
        position: Array,
        velocity: Array,
        slope: Array,
        *,
        age: float = 0.0,
        span: float = 0.0,
        trust: Array | float = 1.0,
        drives: bool = True,
    ) -> Array:
        """Returns the torques (k,) [N m] to send now. Call this method once per period.

        `position` [rad] and `velocity` [rad/s] (n_servos,) were measured `age` [s] ago. `slope` (n_servos,)
        [rad/s] is the mean speed over the time `span` [s] before this measurement.

        - A torque rises gradually: from zero to the largest torque in 20 ms.
        - A joint gets no more torque than makes it as fast as allowed by the time at which the next torque
          takes effect: the least inertia of its links, what was sent since the measurement, and what seems to
          hold or to drive the joint are counted. So a joint that something holds gets more and more torque.
        - If a joint is faster than allowed, or so fast that a stop within half of its acceleration limit
          would end beyond its position limit, it is braked, by no more than ends its motion.
        - Near a limit, a torque towards the limit decreases to zero. Beyond the limit only a slow return is
          allowed.
        - A joint whose readings repeat exactly gets no more torque than lets it stay below its speed limit if
          it is free and its encoder frozen, until a reading answers.
        - A velocity that is not finite sets the commanded torque to zero. A velocity that lags behind `slope`
          is ignored.
        - Each torque is limited to the fraction `trust` (0..1) of the torque that follows from the rules
          above. When `trust` rises again, the torques rise gradually too. Unless it `drives`, a torque may
          only brake: newer data is overdue.
        """
        self._trust = np.broadcast_to(trust, self.servos.shape)
        self._clock += self._period
        taken = self._clock - age
        elapsed = taken - self._taken
        if elapsed < EARLY * self._period:
            elapsed = 0.0
        between = self._acted(age + elapsed) - self._acted(age) if elapsed else np.zeros(len(position))
        if elapsed:
            self._taken = taken
        sums = self._acted(age), self._acted(age + 0.5 * span), between
        measured = Measured(*np.array([position, velocity, slope, *sums]))
        times = Times(age, 0.5 * span, min(elapsed, REMEMBERED), UNDERWAY * self._period, self._period)
        limit_torques(
            self.servos, measured, self._limits, self._trust, self._halts, times, drives, self._push,
            self._memory,
            self._answers,
        )  # fmt: skip
        self._halts[:] = 0.0
        self._pushed.append(self._pushed[-1] + self._period * self._memory.given)
        return self._given()

    def again(self, *, trust: Array | float) -> Array:
        """Returns the torques (k,) [N m] of the last step, reduced if `trust`, the permitted fraction (0..1)
        of the torques, is lower now than in that step. This method is for calls between that step and the
        next step."""
        trust = np.minimum(trust, self._trust)
        share = np.divide(trust, self._trust, out=np.zeros(len(trust)), where=self._trust > 0.0)
        self._memory.risen[self.servos] *= share
        self._memory.given[self.servos] *= share
        self._trust = trust
        return self._given()

    def _given(self) -> Array:
        given: Array = self._memory.given[self.servos]
        return given

    def _acted(self, ago: float) -> Array:
        """Torque times duration [N m s] (n_servos,) whose effect a reading of `ago` [s] does not show."""
        steps = min(ago / self._period + UNDERWAY, len(self._pushed) - 1.0)
        whole = int(steps)
        here, before = self._pushed[-1 - whole], self._pushed[max(-2 - whole, -len(self._pushed))]
        acted: Array = self._pushed[-1] - here + (steps - whole) * (here - before)
        return acted
