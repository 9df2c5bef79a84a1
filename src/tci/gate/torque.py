"""Torque mode: limits for servos whose position is not controlled.

A torque has no position reference that could be kept within limits, so the measured motion decides: the
closer a servo is to a limit, or the faster it moves, the more a braking torque replaces the commanded one.
This needs recent joint data: as it ages, every torque fades to zero, the braking one too, because a braking
torque that continues after its joint has come to rest drives it backwards.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.gate.bounds import APPROACH, MARGIN
from tci.gate.kernels import torques as at
from tci.gate.trajectory import CREEP
from tci.robot.description import Robot

EARLY = 0.01
"""Fraction of a period that does not make data a period older. Assumed: rounding."""
REMEMBERED = 0.05
"""Time [s] for which past torques are kept. Assumed: no torque is computed from older readings."""


class TorqueLimiter:
    """Limits the torques of all servos of a robot that are in torque mode."""

    def __init__(self, robot: Robot, period: float, *, speed_share: float) -> None:
        self._robot = robot
        self._period = period
        self._share = speed_share
        count = len(robot.servos)
        self._memory = np.zeros((5, count))
        self._memory[at.CALM] = 1.0
        self._pushed = deque([np.zeros(count)], maxlen=1 + math.ceil(REMEMBERED / period))
        self._halts = False
        self.servos: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        """Indices (k,) of the servos in torque mode."""
        self._limits = np.zeros((7, 0))
        self._trust = np.zeros(0)

    def set_servos(self, servos: Sequence[int]) -> None:
        """Sets the servos in torque mode, which have all their limits; new ones start at zero torque."""
        fresh = [servo for servo in servos if servo not in self.servos]
        self._memory[:, fresh] = 0.0
        self._memory[at.CALM, fresh] = 1.0
        self.servos = np.array(sorted(servos), dtype=np.intp)
        limits = [self._robot.servos[servo].limits for servo in self.servos]
        rows = [(x.lower, x.upper, x.velocity, x.velocity, x.acceleration, x.acceleration, x.torque)
                for x in limits]  # fmt: skip
        self._limits = np.array(rows, dtype=float).reshape(-1, 7).T.copy()
        self._limits[at.LOWER] += MARGIN
        self._limits[at.UPPER] -= MARGIN
        self._limits[at.VELOCITY] *= self._share
        self._limits[at.CREEP] *= self._share * CREEP
        self._limits[at.APPROACH] *= APPROACH
        self._trust = np.zeros(len(self.servos))

    def ask(self, servos: NDArray[np.intp], torque: Array) -> Array:
        """Sets the commanded `torque` (k,) [N m]; returns it within the servos' limits."""
        limit = np.array([self._robot.servos[servo].limits.torque for servo in servos], dtype=float)
        wanted: Array = np.clip(torque, -limit, limit)
        self._memory[at.WANTED, servos] = wanted
        return wanted

    def relax(self, servos: NDArray[np.intp] | None = None) -> None:
        """Sets the commanded torque of some servos, or of all, to zero; braking continues."""
        self._memory[at.WANTED, slice(None) if servos is None else servos] = 0.0

    def halt(self) -> None:
        """Sets all commanded torques to zero, and brakes any motion in the next step so that nothing
        coasts."""
        self.relax()
        self._halts = True

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
        """Returns the torques (k,) [N m] to send now. Call it once per period.

        `position` and `velocity` (n_servos,) were measured `age` [s] ago; `slope` (n_servos,) is the mean
        speed over the time `span` [s] before.

        At rest far from limits the result is the commanded torque, which rises within RISE. A servo that is
        too fast to stop before its limit by its acceleration limit is braked at once with up to its full
        torque, in proportion if it is nearly at rest. Near a limit a torque towards it fades out; beyond the
        limit only a slow return is allowed. Late data does not show yet how fast recent torques have made a
        servo: a servo that is light for its limits must not exceed its speed limit by then either. A velocity
        that is not finite sets the commanded torque to zero; one that lags behind `slope` is ignored. Torques
        are limited to the fraction `trust` (0..1), and rise again within RISE.
        """
        self._trust = np.broadcast_to(trust, self.servos.shape)
        measured = np.array([position, velocity, slope, self._since(age), self._since(age + 0.5 * span)])
        at.limit_torques(
            self.servos, measured, self._limits, self._trust, self._halts, age + self._period, self._period,
            self._memory,
        )  # fmt: skip
        self._halts = False
        self._pushed.append(self._pushed[-1] + self._period * self._memory[at.GIVEN])
        return self._given()

    def again(self, *, trust: Array | float) -> Array:
        """Returns the torques (k,) [N m] of the last step, less if `trust` (0..1) is less, within a period of
        it."""
        trust = np.minimum(trust, self._trust)
        share = np.divide(trust, self._trust, out=np.zeros(len(trust)), where=self._trust > 0.0)
        self._memory[at.RISEN : at.GIVEN + 1, self.servos] *= share
        self._trust = trust
        return self._given()

    def _given(self) -> Array:
        given: Array = self._memory[at.GIVEN, self.servos]
        return given

    def _since(self, age: float) -> Array:
        """Returns the impulses (n_servos,) [N m s] of the torques given in the latest `age` [s]."""
        steps = min(math.ceil(age / self._period - EARLY), len(self._pushed) - 1)
        return self._pushed[-1] - self._pushed[-1 - steps]
