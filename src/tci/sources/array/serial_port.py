"""A serial port that is only read, without a library."""

from __future__ import annotations

import os
import select

from tci.errors import DriverError


def open_serial(path: str, baud: int) -> int:
    """Opens a port raw, 8N1, and returns its descriptor. Raises DriverError for a system without termios or
    an unknown speed, with advice for a port that this user may not read, and OSError for others."""
    try:
        import termios
        import tty
    except ModuleNotFoundError as error:
        raise DriverError(f"{path}: serial ports need Linux or macOS; valid here: udp, tcp") from error
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise DriverError(f"{path}: baud={baud} is no speed of this system; valid: 9600, 115200, 921600 ...")
    try:
        port = os.open(path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    except PermissionError as error:
        raise DriverError(
            f"{path}: no permission; add yourself to the group dialout, then log in again"
        ) from error
    try:
        tty.setraw(port)
        settings = termios.tcgetattr(port)
        settings[2] |= termios.CLOCAL | termios.CREAD
        settings[4] = settings[5] = speed
        termios.tcsetattr(port, termios.TCSANOW, settings)
    except termios.error as error:
        os.close(port)
        raise DriverError(f"{path} is no serial port: {error}") from error
    return port


def read_serial(port: int, wait: float) -> bytes:
    """What arrived within `wait` [s]; empty if nothing did. Raises OSError if it was unplugged."""
    if not select.select([port], [], [], wait)[0]:
        return b""
    try:
        data = os.read(port, 65536)
    except BlockingIOError:
        return b""
    if not data:
        raise ConnectionResetError("the serial port was unplugged")
    return data
