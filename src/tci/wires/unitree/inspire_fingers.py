"""Commands to the joints of one Inspire hand.

The hand keeps its last target by itself, so nothing needs to be sent at the end, or if this process is
killed: the joints stop there, at most one command behind the gate. A command sets all six joints, since the
bridge writes all six registers; those that nobody commands get their measured angles.
"""

from __future__ import annotations

import numpy as np

from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages.clock import Every
from tci.shared.inspire_dds import ANGLE, CTRL, FULL, LEAVES, encode
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree.inspire_hand import InspireHand, counts

RATE = 50.0
"""Rate [Hz] of commands to a hand. Assumed: each is one write between the bridge's 24 reads of the hand, so
twice as many would cost touch more than they smooth the motion."""
NOT_SET = np.zeros(6, "<i2")


class InspireFingers:
    """The joints of one hand. `repeat` sends the latest targets again and again, until `release`."""

    def __init__(self, node: InterfaceNode, hand: InspireHand) -> None:
        """Opens the topic of commands. Raises DriverError if another program commands this hand."""
        self.hand = hand
        if why := node.fault_of_writers(hand.commands):
            raise DriverError(why)
        self._write = node.out(hand.commands, CTRL)
        self._targets = np.zeros(6, "<i2")
        self._led = self._released = False
        self._due = Every(1.0 / RATE)

    def obey(self, safe: SafeCommand) -> None:
        """Stores the angles that a command contains for this hand's joints. Stiffness and damping have no
        effect: the hand has neither."""
        hand = self.hand
        own = np.isin(safe.servos, hand.servos)
        if own.any():
            place = dict(zip(hand.servos.tolist(), hand.places.tolist(), strict=True))
            places = np.array([place[servo] for servo in safe.servos[own].tolist()])
            self._lead()
            self._targets[places] = counts(places, safe.position[own])

    def hold(self) -> None:
        """Sets the present angles of the fingers as targets, if they were moved. If nobody knows these angles
        any more, they go on to their last targets: old angles would lead them back."""
        if self._led and not self.hand.late:
            self._stay()

    def _lead(self) -> None:
        if not self._led:
            self._led = True
            self._stay()

    def _stay(self) -> None:
        self._targets[:] = np.clip(self.hand.state, LEAVES, FULL)  # a hand at its end measures beyond it

    def repeat(self, now: float) -> None:
        """Sends the latest targets if a command is due at the time `now` [s]. Sends nothing before the first
        targets."""
        if self._led and not self._released and self._due.due(now):
            self._write(encode((NOT_SET, self._targets, NOT_SET, NOT_SET), bytes([ANGLE])))

    def release(self) -> None:
        """Sends nothing more."""
        self._released = True
