"""Of which joints motion asks more than their motors have: they yield, and nobody holds them.

Links that other joints accelerate or turn fast push each joint: at full speed both arms of a G1 ask 65 N m of
its waist, whose motor has 35.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.joint_monitor import Reference
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics

PIECE = 0.008
"""Least time [s] between two looks: a servo notices little of what is shorter."""
MORE = 1.2
"""Factor by which motion may take more than the model says: masses are wrong by that."""
RETURNS = 0.25
"""Time [s] after which a joint must have turned that yielded. A G1's waist took 0.15 s."""
SLOW = float(np.deg2rad(1.0))
"""Speed [rad/s] of all references below which they ask nothing."""


class Overloads:
    """Follows what references ask of motors."""

    def __init__(self, robot: Robot) -> None:
        self._limits = np.array([servo.limits.torque or np.inf for servo in robot.servos])
        self._dynamics: Dynamics | None = None
        self._velocity, self._asks = np.zeros((2, len(robot.servos)))
        self._since = np.full(len(robot.servos), -np.inf)
        self._stamp = -np.inf

    def load(self, dynamics: Dynamics | None) -> None:
        """Sets the links with what they carry; None if nobody knows their masses."""
        self._dynamics = dynamics

    def forget(self) -> None:
        """After the clock went back."""
        self._stamp, self._since[:] = -np.inf, -np.inf

    def remember(self, reference: Reference, measured: Array, now: float) -> None:
        """Notes references at `now` [s], while joints are `measured` (n_servos,) [rad]."""
        passed = now - self._stamp
        if self._dynamics is None or passed < PIECE:
            return
        before, self._velocity = self._velocity, np.zeros(len(measured))
        self._velocity[reference.servos] = reference.velocity
        self._stamp = now
        if max(np.abs(self._velocity).max(), np.abs(before).max()) < SLOW:
            return
        position = measured.copy()
        position[reference.servos] = reference.position
        inertia, bias = self._dynamics.at(position, self._velocity)
        weight = self._dynamics.at(position, np.zeros(len(measured)))[1]
        asks = MORE * (inertia @ (self._velocity - before) / passed + bias - weight)
        # who can't hold the weight is held by something else
        asks += np.where(np.abs(weight) < self._limits, weight, 0.0)
        self._asks = np.where(np.abs(asks) > self._limits, asks, self._asks)
        self._since[np.abs(asks) > self._limits] = now

    def yields(self, side: Array, now: float) -> NDArray[np.bool_]:
        """Which joints (n_servos,) yield at `now` [s] whose references are at larger angles (`side` 1), or at
        smaller ones (-1): their motors lacked torque towards these a moment ago."""
        found: NDArray[np.bool_] = (now - self._since < RETURNS) & (side * self._asks > 0.0)
        return found
