"""Torque mode: limits for servos that are driven by torques, without position control.

In torque mode there is no position reference that could be kept within limits. Therefore the limits use the
measured motion. The closer a servo is to a limit, or the faster it moves, the more a braking torque replaces
the commanded torque. These limits need recent joint data. As the data ages, every torque decreases to zero.
Braking torques decrease too: with old data, a braking torque would still act after the joint has come to
rest, and drive the joint backwards.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

from tci.gate.bounds import APPROACH, MARGIN
from tci.gate.kernels.torques import Limits, Measured, Memory, limit_torques
from tci.gate.way_inside import CREEP, QUICK
from tci.messages.frames import Array
from tci.robot.description import Robot

EARLY = 0.01
"""Fraction of a period below which a remainder is neglected, when the age of data is converted to a number of
periods. Assumed: larger than rounding errors."""
REMEMBERED = 0.05
"""Time [s] for which past torques are stored. Assumed: the age of the readings from which torques are
computed is less than this time."""


class TorqueLimiter:
    """Limits the torques of all servos of a robot that are in torque mode."""

    def __init__(self, robot: Robot, period: float, *, speed_share: float) -> None:
        self._robot = robot
        self._period = period
        self._share = speed_share
        count = len(robot.servos)
        self._memory = Memory(*np.zeros((5, count)))
        self._pushed = deque([np.zeros(count)], maxlen=1 + math.ceil(REMEMBERED / period))
        self._halts = np.zeros(count, np.bool_)
        self.servos: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        """Indices (k,) of the servos in torque mode."""
        self.set_servos(())

    def set_servos(self, servos: Sequence[int]) -> None:
        """Sets which servos are in torque mode: `servos`, and no others. All limits of these servos must be
        known. New servos start at zero torque."""
        fresh = [servo for servo in servos if servo not in self.servos]
        for kept in self._memory:
            kept[fresh] = 0.0
        self._memory.calm[fresh] = 1.0
        self.servos = np.array(sorted(servos), dtype=np.intp)
        limits = [self._robot.servos[servo].limits for servo in self.servos]
        rows = [(x.lower, x.upper, x.velocity, x.acceleration, x.torque) for x in limits]
        lower, upper, velocity, acceleration, torque = np.array(rows, np.float64).reshape(-1, 5).T.copy()
        velocity *= self._share
        creep = CREEP * np.minimum(velocity, QUICK)
        self._limits = Limits(
            lower + MARGIN, upper - MARGIN, velocity, creep, acceleration, APPROACH * acceleration, torque
        )
        self._trust = np.zeros(len(self.servos))

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

    def halt(self, servos: NDArray[np.intp] | EllipsisType = ...) -> None:
        """Sets the commanded torque of some servos, or of all servos, to zero. The next call of `step` brakes
        any motion of these servos."""
        self.relax(servos)
        self._halts[servos] = True

    def step(
        self,
        position: Array,
        velocity: Array,
        slope: Array,
        *,
        age: float = 0.0,
        span: float = 0.0,
        trust: Array | float = 1.0,
    ) -> Array:
        """Returns the torques (k,) [N m] to send now. Call this method once per period.

        `position` [rad] and `velocity` [rad/s] (n_servos,) were measured `age` [s] ago. `slope` (n_servos,)
        [rad/s] is the mean speed over the time `span` [s] before this measurement.

        - At rest and far from limits, the result is the commanded torque, which rises gradually: from zero to
          the largest torque in 20 ms.
        - If a servo moves so fast that a stop within its acceleration limit would end beyond its position
          limit, it is braked immediately, with up to its full torque. If the servo is nearly at rest, the
          braking torque is proportional to the speed.
        - Near a limit, a torque towards the limit decreases to zero. Beyond the limit only a slow return is
          allowed.
        - Late data does not yet show the speed that recent torques have caused. This speed is estimated, so
          that also a light servo does not exceed its speed limit.
        - A velocity that is not finite sets the commanded torque to zero. A velocity that lags behind `slope`
          is ignored.
        - Each torque is limited to the fraction `trust` (0..1) of the torque that follows from the rules
          above. When `trust` rises again, the torques rise gradually too.
        """
        self._trust = np.broadcast_to(trust, self.servos.shape)
        sums = self._since(age), self._since(age + 0.5 * span)
        measured = Measured(*np.array([position, velocity, slope, *sums]))
        limit_torques(
            self.servos, measured, self._limits, self._trust, self._halts, age + self._period, self._period,
            self._memory,
        )  # fmt: skip
        self._halts[:] = False
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

    def _since(self, age: float) -> Array:
        """Returns for each servo (n_servos,) torque times duration [N m s], summed over the torques that were
        sent during the last `age` [s]."""
        steps = min(math.ceil(age / self._period - EARLY), len(self._pushed) - 1)
        return self._pushed[-1] - self._pushed[-1 - steps]
