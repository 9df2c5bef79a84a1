"""Conversion of the gate's commands to targets of motors."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError, UnknownNameError
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Mode
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.dynamics import UPRIGHT, Dynamics
from tci.robot.gravity import STANDARD_GRAVITY
from tci.robot.joint_calibration import JointCalibration
from tci.wires.unitree.handover import holding
from tci.wires.unitree.motors import GAINS, MOTORS, TARGET, UPPER, gains

LEANS = 0.5
"""Time [s] over which the pelvis's accelerometer tells where down is: steps and shakes are shorter."""


class SetPoints:
    """Converts commands for servos to targets of motors. Stores the last commanded stiffness and damping,
    and where down is."""

    def __init__(self, robot: Robot, slots: NDArray[np.intp], *, whole: bool) -> None:
        """Stores the slot (n_servos,) of each servo's motor, -1 for fingers. If `whole` is True, uses the
        gains for rt/lowcmd, otherwise the gains for rt/arm_sdk."""
        self._slots, self._gains = slots, gains(whole=whole)
        self._share = np.ones(MOTORS, GAINS)
        self._dynamics: Dynamics | None = None
        with suppress(DescriptionError, UnknownNameError):  # without masses
            self._dynamics = Dynamics(robot, JointCalibration(robot=robot.name))
        self._most = np.array([servo.limits.torque or 0.0 for servo in robot.servos])
        self._upper = np.isin(slots, UPPER)  # what legs bear, the ground tells
        self._holds, self._moves = np.zeros((2, len(slots)))
        self._down, self._stamp = UPRIGHT.copy(), -np.inf

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
        stiff = safe.servos[~push]
        position, (velocity, rate) = joints.position.copy(), np.zeros((2, len(self._slots)))
        position[stiff], velocity[stiff] = safe.position[~push], safe.velocity[~push]
        rate[stiff] = safe.acceleration[~push]
        self._look(joints)
        self._bear(position, velocity, rate)
        targets["holds"] = self._of_motors(self._holds)
        led = slots[~push[own]]
        targets["tau"][led] = self._of_motors(self._moves)[led]
        targets["holds"][loose] = 0.0
        return chosen, targets

    def here(self, posture: Array, joints: JointReading) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """A mask (29,), True for all motors, and the `TARGET`s (29,) with which they hold `posture` (29,)
        [rad]. `joints` is the latest reading."""
        return np.ones(MOTORS, dtype=bool), holding(posture, self._gains, self.holds(joints))

    def holds(self, joints: JointReading) -> Array:
        """Torques (29,) [N m] with which motors of waist and arms hold their links where they are."""
        self._look(joints)
        still = np.zeros(len(self._slots))
        self._bear(joints.position, still, still)
        return self._of_motors(self._holds)

    def _look(self, joints: JointReading) -> None:
        """Notes where down is. How much is measured doesn't count: an accelerometer that is wrong, or a jump,
        must not multiply torques."""
        if joints.gravity is None or joints.stamp <= self._stamp:
            return
        size = float(np.linalg.norm(joints.gravity))
        if 0.0 < size < np.inf:
            share = min((joints.stamp - self._stamp) / LEANS, 1.0)
            self._down += share * (joints.gravity * (STANDARD_GRAVITY / size) - self._down)
            self._stamp = joints.stamp

    def _bear(self, position: Array, velocity: Array, rate: Array) -> None:
        """Notes what links ask of motors at rest, and in addition while they move with `velocity` [rad/s] and
        `rate` [rad/s2]: 0 without masses, and as before if an angle is not finite."""
        if self._dynamics is None or not np.isfinite(position).all():
            return
        _, weight = self._dynamics.at(position, np.zeros(len(velocity)), self._down)
        inertia, bias = self._dynamics.at(position, velocity, self._down)
        self._holds = np.clip(weight, -self._most, self._most)
        self._moves = np.clip(bias + inertia @ rate, -self._most, self._most) - self._holds

    def _of_motors(self, torque: Array) -> Array:
        found = np.zeros(MOTORS)
        found[self._slots[self._upper]] = torque[self._upper]
        return found
