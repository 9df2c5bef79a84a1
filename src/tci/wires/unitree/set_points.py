"""Conversion of the gate's commands to targets of motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.wires.unitree.handover import holding
from tci.wires.unitree.motors import GAINS, MOTORS, TARGET, gains


class SetPoints:
    """Converts commands for servos to targets of motors. Stores the last commanded stiffness and damping."""

    def __init__(self, slots: NDArray[np.intp], *, whole: bool) -> None:
        """Stores the slot (n_servos,) of each servo's motor, -1 for fingers. If `whole` is True, uses the
        gains for rt/lowcmd, otherwise the gains for rt/arm_sdk."""
        self._slots, self._gains = slots, gains(whole=whole)
        self._share = np.ones(MOTORS, GAINS)

    def of(self, safe: SafeCommand) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """A mask (29,) of the motors under command, and the `TARGET`s (29,) of these motors."""
        own = self._slots[safe.servos] >= 0
        slots = self._slots[safe.servos[own]]
        chosen, targets = np.zeros(MOTORS, dtype=bool), np.zeros(MOTORS, TARGET)
        chosen[slots] = True
        targets["q"][slots], targets["dq"][slots], targets["tau"][slots] = (
            safe.position[own], safe.velocity[own], safe.torque[own]
        )  # fmt: skip
        loose = slots[np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)[own]]
        for gain, shares in (("kp", safe.stiffness), ("kd", safe.damping)):
            for servo, share in shares.items():
                if self._slots[servo] >= 0:
                    self._share[gain][self._slots[servo]] = share
            targets[gain][slots] = (self._gains[gain] * self._share[gain])[slots]
            targets[gain][loose] = 0.0
        return chosen, targets

    def here(self, posture: Array) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """A mask (29,), True for all motors, and the `TARGET`s (29,) with which they hold `posture` (29,)
        [rad]."""
        return np.ones(MOTORS, dtype=bool), holding(posture, self._gains)
