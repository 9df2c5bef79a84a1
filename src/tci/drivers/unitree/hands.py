"""Dex3 hands: their press sensors as patches of skin, their motors as servos.

The binding of the description assigns sensors of a hand to a patch: `<address of="PATCH" to="left:0-1"/>`, or
`to="left"` for all sensors of the left hand. A patch's channels are the 12 values of each sensor, one sensor
after the other. Servos have the names of the motors, or the address `left:MOTOR`.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.source_clock import SourceClock
from tci.drivers.unitree import messages
from tci.drivers.unitree.health import motor_fault
from tci.drivers.unitree.motors import FINGER_MOTORS, SIDES, hand_motor
from tci.drivers.unitree.node import UnitreeNode, latest
from tci.drivers.unitree.wire import TAXELS, decode_hand
from tci.errors import DriverError, FrameError
from tci.frames import Array, read_only
from tci.messages import SkinFrame
from tci.robot.description import Patch, Robot

NO_VALUE = 30_000.0
"""Reading of a place without a sensor (the vendor's)."""


def patches_of(robot: Robot) -> tuple[Patch, ...]:
    """Returns the patches that the binding assigns to a hand, and those that are felt through joints. A G1
    sends no other patches."""
    named = {address.of for address in robot.binding("unitree").addresses}
    return tuple(patch for patch in robot.patches if patch.through_joints or patch.name in named)


def pads_of(robot: Robot, side: str) -> dict[str, slice]:
    """Returns the press sensors of each patch on one hand. Raises DriverError for another address."""
    binding, found = robot.binding("unitree"), {}
    for patch in patches_of(robot):
        if patch.through_joints:
            continue
        to = binding.address(patch.name, "")
        place = re.fullmatch(r"(left|right)(?::(\d{1,2})-(\d{1,2}))?", to)
        if place is None or (place[2] and int(place[3]) < int(place[2])):
            raise DriverError(
                f"{patch.name} is on the hand {to!r}; valid: {', '.join(SIDES)}, or press sensors of one, "
                "such as left:0-1"
            )
        if place[1] == side:
            found[patch.name] = slice(int(place[2]), int(place[3]) + 1) if place[2] else slice(None)
    return found


def fingers_of(robot: Robot, side: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the servos (k,) of one hand's fingers, and the motor (k,) of each."""
    found = [
        (servo.index, motor[1])
        for servo in robot.servos
        if (motor := hand_motor(robot, servo.name)) is not None and motor[0] == side
    ]
    servos, motors = np.array(found, dtype=np.intp).reshape(-1, 2).T
    return servos, motors


class Hand:
    """State of one hand."""

    def __init__(self, robot: Robot, side: str, node: UnitreeNode, *, skin: bool = True) -> None:
        """Opens a reader if the robot has fingers or, with `skin`, patches there. Raises DriverError for a
        wrong address."""
        self.side = side
        self.servos, self.motors = fingers_of(robot, side)
        """Servos (k,) of the fingers, and the motor (k,) of each."""
        pads = pads_of(robot, side) if skin else {}
        self._pads = {patch: pads[patch.name] for patch in robot.patches if patch.name in pads}
        self._topic = f"rt/dex3/{side}/state"
        self.there = bool(len(self.servos) or self._pads)
        """True if the description has this hand."""
        self._states = node.reader(self._topic, messages.HAND_STATE) if self.there else None
        self._source = SourceClock()
        self._lost: NDArray[np.uint32] | None = None
        self.frames: tuple[SkinFrame, ...] = ()
        """Latest frame of each patch; empty before the first."""
        self.state: Any = None
        """Latest records (m,) of MOTOR_STATE; None before the first."""
        self.stamp = -np.inf
        """Time [s] of the latest state."""
        self.fault = ""
        """Reason for which the fingers must not move, until a person connects again; an empty text for
        none."""
        self._count = 0

    def poll(self, now: float) -> None:
        """Reads the latest state, at `now` [s]. Raises DriverError for a hand with another number of sensors
        or too few motors."""
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
                    f"{self._topic} has {len(motors)} motors; valid: {len(FINGER_MOTORS)}, those of a Dex3"
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

    def fill(self, position: Array, velocity: Array, torque: Array) -> None:
        """Sets angles, speeds and torques (n_servos,) of the fingers."""
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
                    f"{self._topic} has {len(pads)} press sensors of {TAXELS} values, {patch.name} has "
                    f"{patch.channels} channels; valid: as many as values"
                )
            made.append(SkinFrame(patch.name, self.stamp, self._count, read_only(own, np.float32)))
        return tuple(made)

    def _values(self, pads: Any) -> NDArray[np.float32]:
        """Returns the readings (p, 12); NaN without a value, and of sensors that have just lost data."""
        values: NDArray[np.float32] = pads["pressure"].copy()
        values[values == NO_VALUE] = math.nan
        lost = pads["lost"].copy()
        if self._lost is not None and len(self._lost) == len(lost):
            values[lost != self._lost] = math.nan
        self._lost = lost
        return values
