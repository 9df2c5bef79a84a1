"""A serial port: without a library, or with pyserial where the system has no termios (COM5)."""

from __future__ import annotations

import os
import select
from contextlib import suppress
from importlib import import_module
from typing import Any

from tci.errors import DriverError
from tci.shared.serial_ports import holders


class SerialPort:
    """A port, raw, 8N1, that no other program of this kind opens at the same time."""

    def __init__(self, path: str, baud: int, *, writes: bool = False) -> None:
        """Raises DriverError for a system without termios and pyserial, an unknown speed, a port that this
        user may not read or that another program has locked, and OSError for others.

        Args:
            path: The port, such as /dev/ttyACM0.
            baud: Its speed [1/s].
            writes: Whether anything will be sent; else the port is opened for reading only.
        """
        self._path = path
        self._library: Any = None
        try:
            import fcntl
            import termios
            import tty
        except ModuleNotFoundError:
            self._library = _with_library(path, baud, "this system has no termios")
            return
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:  # macOS knows none above 230400 by name
            self._library = _with_library(path, baud, f"baud={baud} is no speed of this system")
            return
        flags = (os.O_RDWR if writes else os.O_RDONLY) | os.O_NOCTTY | os.O_NONBLOCK
        try:
            self._port = os.open(path, flags)
        except PermissionError as error:
            raise DriverError(
                f"{path}: no permission; add yourself to the group dialout, then log in again"
            ) from error
        try:
            fcntl.flock(self._port, fcntl.LOCK_EX | fcntl.LOCK_NB)
            tty.setraw(self._port)
            settings = termios.tcgetattr(self._port)
            settings[2] |= termios.CLOCAL | termios.CREAD
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._port, termios.TCSANOW, settings)
            termios.tcflush(self._port, termios.TCIFLUSH)
        except BlockingIOError as error:
            os.close(self._port)
            who = ", ".join(one for one in holders(path) if not one.endswith(f" {os.getpid()}"))
            raise DriverError(f"{path} is held by {who or 'another program'}; end it") from error
        except termios.error as error:
            os.close(self._port)
            raise DriverError(f"{path} is no serial port: {error}") from error

    def read(self, wait: float) -> bytes:
        """What arrived within `wait` [s]; empty if nothing did. Raises OSError if it was unplugged."""
        if self._library is not None:
            self._library.timeout = wait
            first: bytes = self._library.read(1)
            return first + self._library.read(self._library.in_waiting) if first else b""
        if not select.select([self._port], [], [], wait)[0]:
            return b""
        try:
            data = os.read(self._port, 65536)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError(f"{self._path} was unplugged")
        return data

    def write(self, data: bytes) -> None:
        """Raises OSError if the port does not take all of it."""
        if self._library is not None:
            self._library.write(data)
            return
        if os.write(self._port, data) != len(data):
            raise ConnectionResetError(f"{self._path} takes no data")

    def close(self) -> None:
        if self._library is not None:
            self._library.close()
            return
        with suppress(OSError):
            os.close(self._port)


def _with_library(path: str, baud: int, why: str) -> Any:
    """The port, opened by pyserial. Its errors are OSErrors. Raises DriverError without it."""
    try:
        serial = import_module("serial")
    except ModuleNotFoundError as error:
        raise DriverError(
            f"{path}: {why}; valid: pip install pyserial, another baud, or a sender over udp or tcp"
        ) from error
    return serial.Serial(path, baud, timeout=0)
