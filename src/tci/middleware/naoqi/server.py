"""`tci serve nao --via naoqi`: any NAO, such as the simulated one, as a NAOqi service over a real socket.

Its clients are any programs that use NAOqi through `qi`. Joints move as ALMotion moves them, to the latest
target at a share of the top speed, but behind this process's gate. Nobody logs in, so it listens on this
machine only, unless told otherwise.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import qi

from tci.errors import LinkError
from tci.interface.safe_command import SafeCommand
from tci.messages import Mode, Order, Perception, PlatformCommand, Reading, SkinFrame
from tci.middleware.link import Link
from tci.middleware.naoqi import services, words
from tci.middleware.naoqi.session import PORT, first_line
from tci.middleware.server import Server
from tci.model.description import Servo

LOCAL = "127.0.0.1"


class NaoqiServer(Server):
    """Shows the robot of a link as NAOqi would."""

    def __init__(self, link: Link, address: str = "", *, life: str = "disabled") -> None:
        """Listen at `address`, HOST:PORT; `life` is what ALAutonomousLife says at first.

        Raises LinkError when the port is taken.
        """
        super().__init__(link, address)
        self.robot = link.robot
        host, _, port = address.removeprefix("//").rpartition(":")
        if not host and port and not port.isdigit():
            host, port = port, ""
        if port and not port.isdigit():
            raise LinkError(f"address {address!r}; valid: naoqi:HOST:PORT")
        url = f"tcp://{host or LOCAL}:{port or PORT}"
        self._lock = threading.Lock()
        self._moves: dict[int, tuple[float, float]] = {}
        self._shares: dict[int, float] = {}
        self._measured = self._told = link.read().joints.position.tolist()
        self._stiffness = [1.0] * len(self.robot.servos)
        self._frames: dict[str, SkinFrame] = {}
        self._texts: dict[str, tuple[int, str]] = {}
        self._gate = ["run", ""]
        self._session = qi.Session()
        try:
            self._session.listenStandalone(url)
        except RuntimeError as error:
            reason = "the port is taken" if "in use" in str(error) else first_line(error)
            raise LinkError(f"can't listen at {url}: {reason}; valid: --via naoqi:HOST:PORT") from None
        self._services: dict[str, object] = {
            "ALMemory": services.ALMemory(self._keys()),
            "ALAutonomousLife": services.ALAutonomousLife(life),
            "ALSystem": services.ALSystem(),
            "ALMotion": services.ALMotion(self),
        }
        self._ready = False

    def where(self) -> str:
        return f"NAOqi at {', '.join(self._session.endpoints())}"

    def orders(self) -> Sequence[Order]:
        """The latest target of each servo: an older one that nobody took yet is forgotten."""
        with self._lock:
            moves, shares = self._moves, self._shares
            self._moves, self._shares = {}, {}
        orders: list[Order] = []
        if shares:
            orders.append(_command(Mode.STIFFNESS, {s: (share, np.inf) for s, share in shares.items()}))
        if moves:
            orders.append(_command(Mode.POSITION, moves))
        return orders

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self._measured = reading.joints.position.tolist()
        told = list(self._told)
        for servo, angle in zip(sent.servos.tolist(), sent.position.tolist(), strict=True):
            told[servo] = angle
        self._told = told
        for servo, share in sent.stiffness.items():
            self._stiffness[servo] = share
        for frame in reading.skin:
            self._frames[frame.patch] = frame
        self._gate = [sent.state.value, sent.reason]
        if not self._ready:  # as on a robot that starts: its services come when they can do something
            self._ready = True
            for name, one in self._services.items():
                self._session.registerService(name, one)

    def refuse(self, order: Order, reason: str) -> None:
        self._gate = ["refused", reason]

    def close(self) -> None:
        with suppress(RuntimeError):
            self._session.close()

    def measured(self) -> list[float]:
        """Angles [rad] of all servos, measured."""
        return self._measured

    def told(self) -> list[float]:
        """Angles [rad] that all servos were told last."""
        return self._told

    def stiffness(self) -> list[float]:
        """Share 0..1 of all servos."""
        return list(self._stiffness)

    def move(self, servos: Sequence[Servo], angles: Sequence[float], speeds: Sequence[float]) -> None:
        """Let servos go to angles [rad] at speeds [rad/s], from the next period on."""
        with self._lock:
            for servo, angle, speed in zip(servos, angles, speeds, strict=True):
                self._moves[servo.index] = (angle, speed)

    def stiffen(self, servos: Sequence[Servo], shares: Sequence[float]) -> None:
        """Set shares 0..1 of full stiffness, from the next period on."""
        with self._lock:
            self._shares.update({s.index: share for s, share in zip(servos, shares, strict=True)})

    def _keys(self) -> dict[str, Callable[[], Any]]:
        """What ALMemory has of the robot."""
        keys: dict[str, Callable[[], Any]] = {"TCI/Gate": lambda: self._gate}
        for servo in self.robot.servos:
            keys[words.angle_key(servo.name, "Sensor")] = partial(self._measured_angle, servo.index)
            keys[words.angle_key(servo.name, "Actuator")] = partial(self._told_angle, servo.index)
        keys |= dict.fromkeys(words.TOUCH.values(), float)  # nobody touches: 0.0
        for patch, key in words.skin_keys(self.robot, self.robot.binding(words.MIDDLEWARE)).items():
            keys[key] = partial(self._vector, patch)
            keys[words.sequence_key(key)] = partial(self._number, patch)
            keys[words.packed_key(key)] = partial(self._text, patch)
        return keys

    def _measured_angle(self, servo: int) -> float:
        return self._measured[servo]

    def _told_angle(self, servo: int) -> float:
        return self._told[servo]

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
