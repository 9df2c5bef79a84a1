"""Conversion of the gate's commands to targets of motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.wires.unitree.handover import DQ, KP, ROWS, TAU, Q
from tci.wires.unitree.motors import MOTORS, gains


class SetPoints:
    """Converts commands for servos to targets of motors. Stores the last commanded stiffness and damping."""

    def __init__(self, slots: NDArray[np.intp], *, whole: bool) -> None:
        """Stores the slot (n_servos,) of each servo's motor, -1 for fingers. If `whole` is True, uses the
        gains for rt/lowcmd, otherwise the gains for rt/arm_sdk."""
        self._slots, self._gains = slots, gains(whole=whole)
        self._share = np.ones((2, MOTORS))

    def of(self, safe: SafeCommand) -> tuple[NDArray[np.bool_], Array]:
        """Returns a mask (29,) of the motors under command, and the targets (5, 29) of these motors. The rows
        of the targets are angle, velocity, torque, stiffness and damping (q, dq, tau, kp, kd)."""
        own = self._slots[safe.servos] >= 0
        slots = self._slots[safe.servos[own]]
        for row, shares in enumerate((safe.stiffness, safe.damping)):
            for servo, share in shares.items():
                if self._slots[servo] >= 0:
                    self._share[row, self._slots[servo]] = share
        chosen, targets = np.zeros(MOTORS, dtype=bool), np.zeros((ROWS, MOTORS))
        chosen[slots] = True
        targets[Q, slots], targets[DQ, slots], targets[TAU, slots] = (
            safe.position[own], safe.velocity[own], safe.torque[own]
        )  # fmt: skip
        targets[KP:, slots] = (self._gains * self._share)[:, slots]
        loose = slots[np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)[own]]
        targets[KP:, loose] = 0.0
        return chosen, targets

    def here(self, posture: Array) -> tuple[NDArray[np.bool_], Array]:
        """Returns a mask (29,), True for all motors, and targets (5, 29) with which the motors hold `posture`
        (29,) [rad]. The rows of the targets are angle, velocity, torque, stiffness and damping."""
        targets = np.zeros((ROWS, MOTORS))
        targets[Q], targets[KP:] = posture, self._gains
        return np.ones(MOTORS, dtype=bool), targets
