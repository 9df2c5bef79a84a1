"""Conversion of the gate's commands to targets of motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Mode
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.own_weight import OwnWeight
from tci.wires.unitree.handover import holding
from tci.wires.unitree.motors import GAINS, MOTORS, TARGET, UPPER, gains

LEANS = 0.5
"""Time [s] over which the pelvis's accelerometer tells where down is: steps and shakes are shorter."""


class SetPoints:
    """Converts commands for servos to targets of motors. Stores the last commanded stiffness and damping, and
    where down is."""

    def __init__(self, robot: Robot, slots: NDArray[np.intp], *, whole: bool) -> None:
        """Stores the slot (n_servos,) of each servo's motor, -1 for fingers. If `whole` is True, uses the
        gains for rt/lowcmd, otherwise the gains for rt/arm_sdk."""
        self._slots, self._gains = slots, gains(whole=whole)
        self._share = np.ones(MOTORS, GAINS)
        self._weight = OwnWeight(robot)
        self._most = np.array([servo.limits.torque or 0.0 for servo in robot.servos])
        self._upper = np.isin(slots, UPPER)  # what legs bear, the ground tells
        self._holds = np.zeros(MOTORS)
        self._down: Array | None = None
        self._stamp = -np.inf

    def of(self, safe: SafeCommand, joints: JointReading) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """A mask (29,) of the motors under command, and the `TARGET`s (29,) of these motors. `joints` is the
        latest reading."""
        own = self._slots[safe.servos] >= 0
        slots = self._slots[safe.servos[own]]
        chosen, targets = np.zeros(MOTORS, dtype=bool), np.zeros(MOTORS, TARGET)
        chosen[slots] = True
        targets["q"][slots], targets["dq"][slots], targets["tau"][slots] = (
            safe.position[own], safe.velocity[own], safe.torque[own]
        )  # fmt: skip
        push = np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)
        loose = slots[push[own]]
        for gain, shares in (("kp", safe.stiffness), ("kd", safe.damping)):
            for servo, share in shares.items():
                if self._slots[servo] >= 0:
                    self._share[gain][self._slots[servo]] = share
            targets[gain][slots] = (self._gains[gain] * self._share[gain])[slots]
            targets[gain][loose] = 0.0
        position = joints.position.copy()
        position[safe.servos[~push]] = safe.position[~push]
        targets["holds"] = self.holds(joints, position)
        targets["holds"][loose] = 0.0
        return chosen, targets

    def here(self, posture: Array, joints: JointReading) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """A mask (29,), True for all motors, and the `TARGET`s (29,) with which they hold `posture` (29,)
        [rad]. `joints` is the latest reading."""
        return np.ones(MOTORS, dtype=bool), holding(posture, self._gains, self.holds(joints))

    def holds(self, joints: JointReading, position: Array | None = None) -> Array:
        """Torques (29,) [N m] with which motors of waist and arms hold their links at `position` (n_servos,)
        [rad], by default where they are; 0 without masses, and as before if an angle is not finite."""
        if joints.gravity is not None and joints.stamp > self._stamp:
            share = min((joints.stamp - self._stamp) / LEANS, 1.0)
            down = joints.gravity / np.linalg.norm(joints.gravity)
            self._down = down if self._down is None else self._down + share * (down - self._down)
            self._stamp = joints.stamp
        position = joints.position if position is None else position
        if np.isfinite(position).all():
            torque = self._weight.torques(position, self._down)
            self._holds[self._slots[self._upper]] = np.clip(torque, -self._most, self._most)[self._upper]
        return self._holds.copy()
