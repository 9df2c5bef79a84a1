"""Data that the loop of a served robot shares with its NAOqi services, which run in threads of `qi`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from tci.gate.safe_command import SafeCommand
from tci.messages import Mode, Order, PlatformCommand, Reading, SkinFrame
from tci.reasons import text_of
from tci.robot.description import Robot, Servo
from tci.robot.joint_calibration import joint_calibration
from tci.wires.naoqi import words


class Board:
    """The latest measured values and the latest orders. Calls never wait, and older values are dropped."""

    def __init__(self, robot: Robot, first: Reading) -> None:
        """Stores `first`, a reading from before the start of the server."""
        self.robot = robot
        self.measured: list[float] = first.joints.position.tolist()
        """Measured angles [rad] of all servos."""
        self.commanded: list[float] = list(self.measured)
        """Latest commanded angles [rad] of all servos."""
        self.torque = [0.0] * len(robot.servos)
        """Torques [N m] of all servos; 0 if the robot does not report them."""
        self.stiffness = [1.0] * len(robot.servos)
        """Stiffness 0..1 of all servos."""
        self.gate = ["run", ""]
        """State of the gate, and the reason for this state."""
        self._lock = threading.Lock()
        self._moves: dict[int, tuple[float, float]] = {}
        self._shares: dict[int, float] = {}
        self._frames: dict[str, SkinFrame] = {}
        self._texts: dict[str, tuple[int, str]] = {}

    def store_skin(self, reading: Reading) -> None:
        """Stores the skin frames of one period. Called by the loop."""
        for frame in reading.skin:
            self._frames[frame.patch] = frame

    def store(self, reading: Reading, sent: SafeCommand) -> None:
        """Stores joint data, command and gate state of one period. Called by the loop."""
        self.measured = reading.joints.position.tolist()
        if reading.joints.torque is not None:
            self.torque = reading.joints.torque.tolist()
        commanded, stiffness = list(self.commanded), list(self.stiffness)
        for servo, angle in zip(sent.servos.tolist(), sent.position.tolist(), strict=True):
            commanded[servo] = angle
        for servo, share in sent.stiffness.items():
            stiffness[servo] = share
        self.commanded, self.stiffness = commanded, stiffness
        self.gate = [sent.state.value, text_of(sent.reason)]

    def take(self) -> Sequence[Order]:
        """Returns and removes the latest orders, at most one angle and one stiffness for each servo. Called
        by the loop."""
        with self._lock:
            moves, shares = self._moves, self._shares
            self._moves, self._shares = {}, {}
        orders: list[Order] = []
        if shares:
            orders.append(_command(Mode.STIFFNESS, {s: (share, np.inf) for s, share in shares.items()}))
        if moves:
            orders.append(_command(Mode.POSITION, moves))
        return orders

    def move(self, servos: Sequence[Servo], angles: Sequence[float], speeds: Sequence[float]) -> None:
        """Moves servos to angles [rad] at speeds [rad/s], from the next period on."""
        with self._lock:
            for servo, angle, speed in zip(servos, angles, speeds, strict=True):
                self._moves[servo.index] = (angle, speed)

    def stiffen(self, servos: Sequence[Servo], shares: Sequence[float]) -> None:
        """Sets the stiffness of servos to fractions 0..1 of full stiffness, from the next period on."""
        with self._lock:
            self._shares.update({s.index: share for s, share in zip(servos, shares, strict=True)})

    def keys(self) -> dict[str, Callable[[], Any]]:
        """Returns a function for each key of ALMemory. The function returns the present value of the key."""
        keys: dict[str, Callable[[], Any]] = {"TCI/Gate": lambda: self.gate}
        for servo in self.robot.servos:
            keys[words.angle_key(servo.name, "Sensor")] = partial(self._measured, servo.index)
            keys[words.angle_key(servo.name, "Actuator")] = partial(self._commanded, servo.index)
        for name, constant in joint_calibration(self.robot).amperes.items():
            servo = next(servo for servo in self.robot.servos if servo.name == name)
            keys[words.current_key(name)] = partial(self._current, servo.index, constant)
        for patch, names in words.skin_keys(self.robot, self.robot.binding(words.MIDDLEWARE)).items():
            if len(names) > 1:
                keys |= {name: partial(self._channel, patch, place) for place, name in enumerate(names)}
                continue
            (key,) = names
            keys[key] = partial(self._vector, patch)
            keys[words.sequence_key(key)] = partial(self._number, patch)
            keys[words.packed_key(key)] = partial(self._text, patch)
        return keys

    def _measured(self, servo: int) -> float:
        return self.measured[servo]

    def _commanded(self, servo: int) -> float:
        return self.commanded[servo]

    def _current(self, servo: int, constant: float) -> float:
        """Returns the size [A] of a servo's motor current. `constant` is the torque per current [N m/A]."""
        return abs(self.torque[servo]) / constant

    def _channel(self, patch: str, place: int) -> float | None:
        frame = self._frames.get(patch)
        return None if frame is None else float(frame.values[place])

    def _vector(self, patch: str) -> list[float] | None:
        frame = self._frames.get(patch)
        return None if frame is None else frame.values.tolist()

    def _number(self, patch: str) -> int | None:
        frame = self._frames.get(patch)
        return None if frame is None else frame.sequence

    def _text(self, patch: str) -> str | None:
        frame = self._frames.get(patch)
        if frame is None:
            return None
        number, text = self._texts.get(patch, (-1, ""))
        if number != frame.sequence:
            text = words.pack(frame.sequence, frame.values)
            self._texts[patch] = (frame.sequence, text)
        return text


def _command(mode: Mode, values: dict[int, tuple[float, float]]) -> PlatformCommand:
    servos = sorted(values)
    return PlatformCommand(
        mode,
        np.array(servos, dtype=np.intp),
        np.array([values[servo][0] for servo in servos]),
        np.array([values[servo][1] for servo in servos]),
    )
