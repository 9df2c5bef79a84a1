"""Commands to the motors of one Dex3 hand.

Each command requests that the motors stop by themselves one second after the last command. Therefore the
fingers stop if this process is killed. Unlike the arms, they need no second process (keeper).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.messages.clock import Every
from tci.messages.frames import Array
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree import messages
from tci.wires.unitree.hands import Hand
from tci.wires.unitree.motors import FINGER_GAINS, FINGER_MOTORS
from tci.wires.unitree.wire import MOTOR_COMMAND, encode_hand_command

FOLLOWS, TIMEOUT = 1 << 4, 1 << 7
"""Bits of a motor's mode. FOLLOWS: the motor follows commands. TIMEOUT: the motor stops one second after the
last command. The other bits are the motor's number."""
RATE = 100.0
"""Rate [Hz] of commands to a hand, equal to the rate of the vendor's programs."""
LAST = 5
"""Number of times that the command to stop is sent. Assumed: at most four commands are lost."""


class FingerMotors:
    """The motors of one hand. `repeat` sends the latest targets again and again, until `release` switches the
    motors off."""

    def __init__(self, node: InterfaceNode, hand: Hand) -> None:
        """Opens the topic of commands. Raises DriverError if another program commands this hand."""
        self.hand = hand
        if why := node.fault_of_writers(hand.commands):
            raise DriverError(why)
        self._write = node.out(hand.commands, messages.HAND_COMMAND)
        self._command: Any = np.zeros(len(FINGER_MOTORS), MOTOR_COMMAND)
        self._share = np.ones((2, len(FINGER_MOTORS)))
        self._numbers = np.arange(len(FINGER_MOTORS))
        self._led = self._released = False
        self._due = Every(1.0 / RATE)

    def obey(self, safe: SafeCommand) -> None:
        """Stores the targets that a command contains for this hand's motors. Motors without a command keep
        the previous targets."""
        hand = self.hand
        place = dict(zip(hand.servos.tolist(), hand.motors.tolist(), strict=True))
        for row, shares in enumerate((safe.stiffness, safe.damping)):
            for servo, share in shares.items():
                if servo in place:
                    self._share[row, place[servo]] = share
        own = np.isin(safe.servos, hand.servos)
        if own.any():
            motors = np.array([place[servo] for servo in safe.servos[own].tolist()])
            stiff = np.array([mode is not Mode.TORQUE for mode in safe.modes])[own]
            self._follow(motors, safe.position[own], safe.velocity[own], safe.torque[own], stiff)

    def hold(self) -> None:
        """Sets the present angles of the fingers as targets."""
        motors = self.hand.motors
        none = np.zeros(len(motors))
        self._follow(motors, self.hand.state["q"][motors], none, none, none == 0.0)

    def _follow(
        self, motors: NDArray[np.intp], q: Array, dq: Array, tau: Array, stiff: NDArray[np.bool_]
    ) -> None:
        """Sets target angles [rad], speeds [rad/s] and torques [N m] (k,) of the motors `motors` (k,).

        A motor that is not `stiff` follows only the target torque. At the first call, all other motors keep
        their present angles.
        """
        command = self._command
        if self._released:
            return
        if not self._led:
            self._led = True
            command["mode"] = self._numbers | FOLLOWS | TIMEOUT
            command["q"], (command["kp"], command["kd"]) = self.hand.state["q"][: len(command)], FINGER_GAINS
        command["dq"], command["tau"] = 0.0, 0.0
        command["q"][motors], command["dq"][motors], command["tau"][motors] = q, dq, tau
        kp, kd = FINGER_GAINS[:, None] * self._share[:, motors] * stiff
        command["kp"][motors], command["kd"][motors] = kp, kd

    def repeat(self, now: float) -> None:
        """Sends the latest targets if a command is due at the time `now` [s]. Sends nothing before the first
        targets."""
        if self._led and self._due.due(now):
            self._write(encode_hand_command(self._command))

    def release(self) -> None:
        """Switches the motors off. Commands after this call have no effect."""
        self._released = True
        if self._led:
            self._led = False
            self._command[:] = np.zeros((), MOTOR_COMMAND)
            self._command["mode"] = self._numbers | TIMEOUT
            for _ in range(LAST):
                self._write(encode_hand_command(self._command))
