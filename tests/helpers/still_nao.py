"""A NAO without physics behind the genuine `qi` library. Its joints reach commanded angles immediately."""

from __future__ import annotations

import socket
import ssl
import struct
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from helpers.served import needs_qi
from tci.messages import JointReading, Mode, PlatformCommand, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position


class StillNao:
    """A NAOqi service in this process. Tests set its joint angles and its skin values."""

    def __init__(self, robot: Robot | None = None, port: int = 0, without: tuple[str, ...] = ()) -> None:
        needs_qi()
        import qi

        from tci.wires.naoqi.board import Board
        from tci.wires.naoqi.services import all_services

        self.robot = robot or load_robot("nao")
        position = read_only(initial_position(self.robot))
        joints = JointReading(0.0, 0, position, read_only(np.zeros_like(position)))
        frames = [
            SkinFrame(patch.name, 0.0, 0, np.full(patch.channels, patch.sensor.rest, np.uint8))
            for patch in self.robot.patches
        ]
        self.board = Board(self.robot, Reading(joints, tuple(frames)))
        for frame in frames:
            self.board._frames[frame.patch] = frame
        self.session = qi.Session()
        self.session.listenStandalone(f"tcp://127.0.0.1:{port}")
        self.services: dict[str, Any] = all_services(self.board)
        for name, service in self.services.items():
            if name not in without:
                self.session.registerService(name, service)

    @property
    def port(self) -> int:
        return int(self.session.endpoints()[0].rsplit(":", 1)[1])

    @property
    def via(self) -> str:
        return f"naoqi://127.0.0.1:{self.port}"

    def obey(self) -> list[PlatformCommand]:
        """Executes the orders that have arrived, without delay, and returns them."""
        orders = [order for order in self.board.take() if isinstance(order, PlatformCommand)]
        for order in orders:
            values = self.board.stiffness if order.mode is Mode.STIFFNESS else self.board.measured
            for servo, value in zip(order.servos.tolist(), order.values.tolist(), strict=True):
                values[servo] = value
        return orders

    def touch(self, patch: str, sequence: int, values: np.ndarray) -> None:
        """Stores a skin frame."""
        self.board._frames[patch] = SkinFrame(patch, 0.0, sequence, values)

    def close(self) -> None:
        self.session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


AUTHENTICATE = 8
"""Number of the call with which a client of NAOqi authenticates. The header of a call has 28 bytes."""


class Doorman:
    """Front end of a NAO that requires encryption and credentials, as NAOqi 2.9 does."""

    def __init__(self, nao: StillNao, user: str, password: str, folder: Path) -> None:
        key, certificate = folder / "key.pem", folder / "certificate.pem"
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", str(key), "-out",
             str(certificate), "-days", "2", "-subj", "/CN=localhost"],
            check=True, capture_output=True,
        )  # fmt: skip
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(certificate, key)
        self._words = [
            _text("auth_user") + _text("m") + _dynamic(user),
            _text("auth_token") + _text("m") + _dynamic(password),
        ]
        self._nao = nao
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        self.refused = 0
        threading.Thread(target=self._answer, daemon=True).start()

    def close(self) -> None:
        self._door.close()

    def _answer(self) -> None:
        while True:
            try:
                guest = self._context.wrap_socket(self._door.accept()[0], server_side=True)
            except OSError:
                return
            threading.Thread(target=self._look, args=(guest,), daemon=True).start()

    def _look(self, guest: ssl.SSLSocket) -> None:
        first = guest.recv(65536)
        number, size = struct.unpack_from("<II", first, 4)
        assert struct.unpack_from("<I", first, 24)[0] == AUTHENTICATE
        while len(first) < 28 + size:
            first += guest.recv(65536)
        if not all(word in first for word in self._words):
            self.refused += 1
            words = _dynamic("Authentication failed")
            guest.sendall(struct.pack("<IIIHBBIII", 0x42ADDE42, number, len(words), 0, 3, 0, 0, 0, 8) + words)
            guest.close()
            return
        inside = socket.create_connection(("127.0.0.1", self._nao.port))
        inside.sendall(first)
        for source, target in ((guest, inside), (inside, guest)):
            threading.Thread(target=_pump, args=(source, target), daemon=True).start()


def _pump(source: socket.socket, target: socket.socket) -> None:
    try:
        while data := source.recv(65536):
            target.sendall(data)
    except OSError:
        pass
    finally:
        target.close()


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _dynamic(text: str) -> bytes:
    """Returns a string, encoded as NAOqi's dynamic type."""
    return _text("s") + _text(text)
