"""Simulated joints with masses, friction and mechanical stops, which execute the gate's commands and return
readings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import Robot

STEP = 2.5e-4
"""Integration step [s]."""
STOP = 250.0
"""Natural frequency [rad/s] of a joint on its mechanical stop. It is as high as the integration step
permits."""
SERVO = 200.0
"""Natural frequency [rad/s] of a servo with a joint of the expected mass, while the servo holds its
position."""
SPARE = 3.0
"""Largest torque of such a servo, as a multiple of the torque for the expected mass. The firmware of a servo
limits the torque."""
SOFT = 0.3
"""Stiffness in impedance mode as a fraction of the stiffness in position mode."""
FREE, HELD, YIELDING = range(3)


class Plant:
    """Joints without coupling: inertia, friction, incompletely compensated weight, and mechanical stops.

    With a torque equal to its limit, a joint of the expected mass accelerates at the servo's acceleration
    limit.
    """

    def __init__(self, robot: Robot, position: Array, random: np.random.Generator, *, wrong: float = 0.3):
        """Creates joints at `position` (n,) [rad]. `wrong` is the largest relative error of the expected
        masses."""
        limits, count = [servo.limits for servo in robot.servos], len(robot.servos)
        self.lower = np.array([-np.inf if x.lower is None else x.lower for x in limits])
        self.upper = np.array([np.inf if x.upper is None else x.upper for x in limits])
        self.torque = np.array([x.torque or 1.0 for x in limits])
        expected = self.torque / np.array([x.acceleration or 1.0 for x in limits])
        self.inertia = expected * random.uniform(1.0 - wrong, 1.0 + wrong, count)
        """Inertia (n,) [kg m2] of each joint."""
        self._expected = expected
        self.dry = self.torque * random.uniform(0.0, 0.02, count)
        """Dry friction (n,) [N m]."""
        self.weight = self.torque * random.uniform(0.0, 0.02, count)
        """Largest torque (n,) [N m] of the weight that is not compensated because the expected mass is
        wrong."""
        self.hangs = random.uniform(-np.pi, np.pi, count)
        """Angle (n,) [rad] at which this weight hangs down."""
        self.position, self.velocity = np.array(position, dtype=float), np.zeros(count)
        self._modes = np.full(count, HELD)
        self._target, self._speed = self.position.copy(), np.zeros(count)
        self.sent = np.zeros(count)
        """Torques (n,) [N m] that were sent last. They act until the next torques are sent."""

    def obey(self, safe: SafeCommand) -> None:
        """Stores a command, as the firmware of a robot does."""
        kinds = {Mode.TORQUE: FREE, Mode.IMPEDANCE: YIELDING}
        modes = np.array([kinds.get(mode, HELD) for mode in safe.modes], dtype=int)
        self._modes[safe.servos] = modes
        self._target[safe.servos], self._speed[safe.servos] = safe.position, safe.velocity
        self.sent[safe.servos] = np.where(modes == FREE, safe.torque, 0.0)

    def advance(self, time: float) -> None:
        """Simulates `time` [s]."""
        _advance(
            self.position, self.velocity, self._modes, self._target, self._speed, self.sent, self.inertia,
            self._expected, self.dry, self.weight, self.hangs, self.torque, self.lower, self.upper,
            round(time / STEP),
        )  # fmt: skip

    @property
    def beyond(self) -> Array:
        """Returns the depth (n,) [rad] to which each joint is pressed into a stop."""
        return np.maximum(np.maximum(self.position - self.upper, self.lower - self.position), 0.0)

    @property
    def energy(self) -> Array:
        """Returns the energy (n,) [J] of each joint: kinetic energy and the potential energies of weight and
        mechanical stop."""
        energy: Array = (
            0.5 * self.inertia * self.velocity**2
            + self.weight * (1.0 - np.cos(self.position - self.hangs))
            + 0.5 * self.inertia * (STOP * self.beyond) ** 2
        )
        return energy


def _loop(
    position: Any, velocity: Any, modes: Any, target: Any, speed: Any, sent: Any, inertia: Any, expected: Any,
    dry: Any, weight: Any, hangs: Any, most: Any, lower: Any, upper: Any, steps: int,
) -> None:  # fmt: skip
    for i in range(len(position)):
        q, v = position[i], velocity[i]
        for k in range(steps):
            torque = sent[i]
            if modes[i] != FREE:
                share = SOFT if modes[i] == YIELDING else 1.0
                here = target[i] - speed[i] * STEP * (steps - 1 - k)
                torque = (
                    expected[i] * SERVO * (share * SERVO * (here - q) + 2.0 * share**0.5 * (speed[i] - v))
                )
                torque = min(max(torque, -SPARE * most[i]), SPARE * most[i])
            torque -= weight[i] * np.sin(q - hangs[i])
            beyond = max(q - upper[i], 0.0) + min(q - lower[i], 0.0)
            if beyond != 0.0:
                torque -= inertia[i] * STOP * (STOP * beyond + 1.4 * v)
            v += torque / inertia[i] * STEP
            lost = dry[i] / inertia[i] * STEP
            v = max(v - lost, 0.0) if v > 0.0 else min(v + lost, 0.0)
            q += v * STEP
        position[i], velocity[i] = q, v


_advance: Any = njit(cache=True)(_loop)
