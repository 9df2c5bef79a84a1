"""Player's messages over TCP: big-endian XDR after a header of 40 bytes. Pure functions with bounded
lengths."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.frames import Array, doubles

HEADER = struct.Struct(">IIIIIIdII")
"""Host, robot (port of the server), interface, index; type, subtype; time [s], sequence, number of bytes that
follow."""
GREETING = 32
"""Number of bytes that a server sends first: its version, then zeros."""
MOST = 1 << 20
"""Longest body [bytes] that is accepted. Assumed: far above a skin frame; Player's own limit is 8 MiB."""
PLAYER, OPAQUE, ACTARRAY = 1, 51, 53
"""Codes of interfaces."""
DEVLIST, DRIVERINFO, SUBSCRIBE, GET, DATAMODE = 1, 2, 3, 4, 5
"""Requests to the server itself."""
STATE, POSITIONS, GEOMETRY, POWER = 1, 2, 3, 1
"""Subtypes of an actarray: data, command of all positions, requests."""
POSITION = 1
"""Subtype of an actarray: command of one position."""
FACTS = 1
"""Request to `opaque:99` of a TCI process for the robot's facts as JSON."""
OPEN, CLOSE, ERROR = 1, 2, 3
"""Access modes of a device that a client requests, or gets."""
PUSH = 1
IDLE, MOVING, ROTARY = 1, 2, 2


class Kind(IntEnum):
    """Type of a message."""

    DATA = 1
    COMMAND = 2
    REQUEST = 3
    ACK = 4
    SYNCH = 5
    NACK = 6


@dataclass(frozen=True, slots=True)
class Message:
    """One message."""

    interface: int
    index: int
    kind: int
    subtype: int
    stamp: float
    """Time [s] on the sender's clock."""
    body: bytes
    host: int = 0
    robot: int = 0

    def to_bytes(self, sequence: int = 0) -> bytes:
        """Returns the message as bytes for the wire."""
        head = HEADER.pack(
            self.host, self.robot, self.interface, self.index, self.kind, self.subtype, self.stamp, sequence,
            len(self.body),
        )  # fmt: skip
        return head + self.body


class Stream:
    """Splits the bytes of one connection into messages."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yields the messages that are complete now. Raises FrameError for a body longer than MOST, which
        ends the stream."""
        self._bytes += data
        at = 0
        while len(self._bytes) - at >= HEADER.size:
            host, robot, interface, index, kind, subtype, stamp, _, size = HEADER.unpack_from(self._bytes, at)
            if size > MOST:
                raise FrameError(f"Player: a body of {size} bytes declared; valid: at most {MOST}")
            end = at + HEADER.size + size
            if end > len(self._bytes):
                break
            body = bytes(self._bytes[at + HEADER.size : end])
            at = end
            yield Message(interface, index, kind, subtype, stamp, body, host, robot)
        del self._bytes[:at]


def array(items: bytes, count: int) -> bytes:
    """Returns a variable array: Player's count, XDR's count, the items."""
    return struct.pack(">II", count, count) + items


def floats(values: Sequence[float] | Array) -> bytes:
    """Returns an array of 32-bit floats as bytes."""
    return array(np.asarray(values, dtype=">f4").tobytes(), len(values))


def to_floats(body: bytes) -> Array:
    """Returns the numbers of such an array. Raises FrameError."""
    count = _count(body, 4)
    return doubles(np.frombuffer(body, dtype=">f4", count=count, offset=8))


def blob(data: bytes) -> bytes:
    """Returns the body of an opaque message: bytes, padded to four."""
    return array(data + bytes(-len(data) % 4), len(data))


def to_blob(body: bytes) -> bytes:
    """Returns the bytes in such a body. Raises FrameError."""
    return body[8 : 8 + _count(body, 1)]


ACTUATOR = np.dtype([("position", ">f4"), ("speed", ">f4"), ("rest", ">f4", 2), ("state", ">u4")])


def actuators(position: Array, velocity: Array) -> bytes:
    """Returns the state of an actarray as bytes: positions [rad] and speeds [rad/s]."""
    found = np.zeros(len(position), dtype=ACTUATOR)
    found["position"], found["speed"] = position, velocity
    found["state"] = np.where(np.abs(velocity) > 1e-3, MOVING, IDLE)
    return array(found.tobytes(), len(position)) + struct.pack(">I", 1)


def to_actuators(body: bytes) -> tuple[Array, Array]:
    """Returns positions [rad] and speeds [rad/s] from such a state. Raises FrameError."""
    found = np.frombuffer(body, dtype=ACTUATOR, count=_count(body, ACTUATOR.itemsize, rest=4), offset=8)
    return doubles(found["position"]), doubles(found["speed"])


def geometry(limits: Sequence[tuple[float, float, float, float]]) -> bytes:
    """Returns the geometry of an actarray: least, greatest and first position [rad], and speed [rad/s] of
    each joint.

    Lengths and axes are zero: links are in the robot's facts.
    """
    joints = b"".join(
        struct.pack(">If6d5fI", ROTARY, 0.0, *([0.0] * 6), low, (low + high) / 2, high, home, speed, 0)
        for low, high, home, speed in limits
    )
    return array(joints, len(limits)) + struct.pack(">6d", *([0.0] * 6))


def devices(found: Sequence[tuple[int, int]], robot: int) -> bytes:
    """Returns the list of devices as bytes: interface and index of each; the count is written twice."""
    items = b"".join(struct.pack(">IIII", 0, robot, interface, index) for interface, index in found)
    return array(items, len(found))


def to_devices(body: bytes) -> list[tuple[int, int]]:
    """Returns the devices in such a list. Raises FrameError."""
    count = _count(body, 16)
    return [struct.unpack_from(">II", body, 16 + 16 * item) for item in range(count)]


def access(interface: int, index: int, mode: int, robot: int, driver: bytes = b"") -> bytes:
    """Returns a request for a device, or its answer, as bytes."""
    return struct.pack(">IIIII", 0, robot, interface, index, mode) + blob(driver)


def to_access(body: bytes) -> tuple[int, int, int]:
    """Returns interface, index and mode. Raises FrameError."""
    if len(body) < 20:
        raise FrameError(f"Player: access to a device in {len(body)} bytes; valid: 20 and a name")
    interface, index, mode = struct.unpack_from(">III", body, 8)
    return interface, index, mode


FORMATS = {1: ">u1", 2: ">u2", 4: ">f4", 8: ">f8"}
"""Data types of raw skin values, by their bytes per channel."""


def skin(values: NDArray[np.generic]) -> bytes:
    """Returns raw values as bytes for an opaque message: integers of one or two bytes, else floats."""
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind not in "bu" or size > 2:
        size = 4 if (kind, size) == ("f", 4) else 8
    return values.astype(FORMATS[size]).tobytes()


def to_skin(data: bytes, channels: int) -> NDArray[np.generic]:
    """Returns the raw values in such bytes. Raises FrameError if `data` is no whole number of bytes per
    channel."""
    size, rest = divmod(len(data), channels)
    if rest or size not in FORMATS:
        raise FrameError(f"skin of {channels} channels in {len(data)} bytes; valid: 1, 2, 4 or 8 for each")
    return np.frombuffer(data, dtype=FORMATS[size]).astype(FORMATS[size].replace(">", "<"))


def _count(body: bytes, size: int, rest: int = 0) -> int:
    """Returns the number of items of `size` bytes in a variable array, checked against the length."""
    if len(body) < 8:
        raise FrameError(f"Player: an array in {len(body)} bytes; valid: 8 and its items")
    first, second = struct.unpack_from(">II", body)
    if first != second or 8 + first * size + rest > len(body):
        raise FrameError(
            f"Player: {first} and {second} items of {size} bytes declared, {len(body)} bytes there"
        )
    return int(first)
