"""Reads Dex3 hands. Press sensors become skin patches, and motors become servos.

The binding in the robot's description assigns press sensors of a hand to a patch: `<address of="PATCH"
to="left:0-1"/>`, or `to="left"` for all sensors of the left hand. The channels of a patch are the 12 values
of its first sensor, then those of the next sensor, and so on. A servo belongs to the motor with the servo's
name, or to the motor in its address `left:MOTOR`.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.source_clock import SourceClock
from tci.errors import DriverError, FrameError
from tci.messages import SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.description import Patch, Robot
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.health import motor_fault
from tci.wires.unitree.inspire_hand import inspire_pads
from tci.wires.unitree.motors import FINGER_MOTORS, SIDES, hand_motor
from tci.wires.unitree.wire import TAXELS, decode_hand

NO_VALUE = 30_000.0
"""Value that the hand sends for a place without a sensor; defined by the vendor."""


def patches_of(robot: Robot) -> tuple[Patch, ...]:
    """Returns the patches for which a G1 can send data. These are the patches that the binding assigns to a
    hand, and the patches whose touches are detected by joint torques.
    """
    named = {address.of for address in robot.binding("unitree").addresses}
    named |= {name for side in SIDES for name in inspire_pads(robot, side)}
    return tuple(patch for patch in robot.patches if patch.through_joints or patch.name in named)


def pads_of(robot: Robot, side: str) -> dict[str, slice]:
    """Returns the press sensors of each patch on one hand. Raises DriverError for an invalid address."""
    binding, found = robot.binding("unitree"), {}
    others = {name for one in SIDES for name in inspire_pads(robot, one)}
    for patch in patches_of(robot):
        if patch.through_joints or patch.name in others:
            continue
        to = binding.address(patch.name, "")
        place = re.fullmatch(r"(left|right)(?::(\d{1,2})-(\d{1,2}))?", to)
        if place is None or (place[2] and int(place[3]) < int(place[2])):
            raise DriverError(
                f"{patch.name} is on the hand {to!r}; valid: {', '.join(SIDES)}, or press sensors of one, "
                "such as left:0-1; or a pad of an Inspire hand, such as left:index_tip"
            )
        if place[1] == side:
            found[patch.name] = slice(int(place[2]), int(place[3]) + 1) if place[2] else slice(None)
    return found


def fingers_of(robot: Robot, side: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the indices (k,) of the servos of one hand's fingers, and the numbers (k,) of their motors."""
    found = [
        (servo.index, motor[1])
        for servo in robot.servos
        if (motor := hand_motor(robot, servo.name)) is not None and motor[0] == side
    ]
    servos, motors = np.array(found, dtype=np.intp).reshape(-1, 2).T
    return servos, motors


class Hand:
    """Reader of one hand's state: finger motors and press sensors."""

    def __init__(self, robot: Robot, side: str, node: InterfaceNode, *, skin: bool = True) -> None:
        """Opens a reader if the robot has fingers or, with `skin`, patches on this hand.

        Raises DriverError if an address in the binding is invalid.
        """
        self.side = side
        self.servos, self.motors = fingers_of(robot, side)
        """Indices (k,) of the servos of the fingers, and numbers (k,) of their motors."""
        pads = pads_of(robot, side) if skin else {}
        self._pads = {patch: pads[patch.name] for patch in robot.patches if patch.name in pads}
        self.topic, self.commands = f"rt/dex3/{side}/state", f"rt/dex3/{side}/cmd"
        self.there = bool(len(self.servos) or self._pads)
        """True if the robot's description has fingers or patches on this hand."""
        self._states = node.reader(self.topic, messages.HAND_STATE) if self.there else None
        self._source = SourceClock()
        self._lost: NDArray[np.uint32] | None = None
        self.frames: tuple[SkinFrame, ...] = ()
        """Latest frame of each patch; empty before the first state."""
        self.state: Any = None
        """Latest states (m,) of the hand's motors, as records MOTOR_STATE. The value is None before the first
        state."""
        self.stamp = -np.inf
        """Time [s] of the latest state."""
        self.fault = ""
        """Reason for which the fingers must not move until a person connects again. The text is empty if the
        fingers may move."""
        self.given_up = False
        """True if nobody waits for its angles any more."""
        self._count = 0

    @property
    def heard(self) -> bool:
        """True as soon as the motors' angles are known."""
        return self.state is not None or not len(self.servos)

    @property
    def missing(self) -> str:
        """Why the angles are not known."""
        return f"no state of the {self.side} hand"

    def overdue(self, now: float) -> bool:
        """False: see `silent`."""
        return False

    def silent(self, now: float) -> str:
        """Empty: the joint data has the stamp of the hand's latest state, so the gate sees how old it is."""
        return ""

    def poll(self, now: float) -> None:
        """Reads the latest state of the hand; `now` [s] is the present time.

        Raises DriverError if the number of press sensors is wrong or there are too few motors.
        """
        for sample in latest(self._states) if self._states is not None else ():
            try:
                motors, pads, errors = decode_hand(sample.raw)
            except FrameError:
                continue
            stamp = self._source.place(sample.sample_info.source_timestamp * 1e-9, now)
            if stamp is None:
                continue
            if len(self.servos) and len(motors) < len(FINGER_MOTORS):
                raise DriverError(
                    f"{self.topic} has {len(motors)} motors; valid: {len(FINGER_MOTORS)}, those of a Dex3"
                )
            self.state, self.stamp = motors, min(stamp, now)
            if len(self.servos):
                self.fault = self.fault or self._fault(motors[: len(FINGER_MOTORS)], errors)
            if self._pads:
                self.frames = self._frames(pads)

    def _fault(self, motors: Any, errors: Any) -> str:
        names = [f"{self.side}_hand_{name}" for name in FINGER_MOTORS]
        reported = ", ".join(map(str, errors.tolist()))
        return motor_fault(motors, names) or (
            f"the {self.side} hand reports the errors {reported}" if errors.any() else ""
        )

    def fill(self, position: Array, velocity: Array, torque: Array, now: float) -> None:
        """Writes the fingers' angles [rad], speeds [rad/s] and torques [N m] into the arrays (n_servos,)."""
        for name, values in (("q", position), ("dq", velocity), ("tau_est", torque)):
            values[self.servos] = self.state[name][self.motors]

    def _frames(self, pads: Any) -> tuple[SkinFrame, ...]:
        values = self._values(pads)
        self._count += 1
        made = []
        for patch, chosen in self._pads.items():
            own = values[chosen].ravel()
            if len(own) != patch.channels or (chosen.stop or 0) > len(values):
                raise DriverError(
                    f"{self.topic} has {len(pads)} press sensors of {TAXELS} values, {patch.name} has "
                    f"{patch.channels} channels; valid: as many as values"
                )
            made.append(SkinFrame(patch.name, self.stamp, self._count, read_only(own, np.float32)))
        return tuple(made)

    def _values(self, pads: Any) -> NDArray[np.float32]:
        """Returns the raw values (p, 12) of p press sensors with 12 places each.

        A value is NaN if its place is not used, or if its press sensor reports that data was lost since the
        last state.
        """
        values: NDArray[np.float32] = pads["pressure"].copy()
        values[values == NO_VALUE] = math.nan
        lost = pads["lost"].copy()
        if self._lost is not None and len(self._lost) == len(lost):
            values[lost != self._lost] = math.nan
        self._lost = lost
        return values
