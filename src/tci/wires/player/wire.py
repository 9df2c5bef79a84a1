"""Encodes and decodes Player's messages over TCP. A message has a header of 40 bytes, then a body in
big-endian XDR. The functions have no side effects, and check every length in a message before they use it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.messages.frames import Array, doubles

HEADER = struct.Struct(">IIIIIIdII")
"""The header of a message, in this order:

- address of the device: host, robot (port of the server), interface, index
- type and subtype of the message
- time [s], sequence number, number of bytes in the body
"""
GREETING = 32
"""Number of bytes in a server's greeting after a client connects: the version, then zeros."""
MOST = 1 << 20
"""Length [bytes] of the longest accepted body. Assumed: a skin frame is far shorter. Player's own limit is 8
MiB."""
PLAYER, OPAQUE, ACTARRAY = 1, 51, 53
"""Player's codes of the three interfaces."""
DEVLIST, DRIVERINFO, SUBSCRIBE, GET, DATAMODE = 1, 2, 3, 4, 5
"""Subtypes of requests to the server itself, not to a device."""
STATE, POSITIONS, GEOMETRY, POWER = 1, 2, 3, 1
"""Subtypes of an actarray's messages: data, command of all positions, and the requests for geometry and
power."""
POSITION = 1
"""Subtype of a command that sets one position of an actarray."""
FACTS = 1
"""Subtype of the request for the robot's facts as JSON. Only a TCI process answers this request, on the
device opaque:99."""
OPEN, CLOSE, ERROR = 1, 2, 3
"""Access modes of a device: the client requests OPEN or CLOSE, and the server answers with the mode or
ERROR."""
PUSH = 1
IDLE, MOVING, ROTARY = 1, 2, 2


class MessageKind(IntEnum):
    """Type of a message."""

    DATA = 1
    COMMAND = 2
    REQUEST = 3
    ACK = 4
    SYNCH = 5
    NACK = 6


@dataclass(frozen=True, slots=True)
class Message:
    """One message of Player."""

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
        """Returns the message as bytes for the connection."""
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
        """Adds received bytes and yields the messages that are complete. Raises FrameError for a body longer
        than 1 MiB (MOST). After this error, the stream is no longer usable.
        """
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
    """Returns a variable array as bytes: Player's count of items, XDR's count of items, then the items."""
    return struct.pack(">II", count, count) + items


def floats(values: Sequence[float] | Array) -> bytes:
    """Returns an array of 32-bit floats as bytes."""
    return array(np.asarray(values, dtype=">f4").tobytes(), len(values))


def to_floats(body: bytes) -> Array:
    """Returns the numbers in an array of 32-bit floats, given as bytes. Raises FrameError if the bytes are
    invalid."""
    count = _count(body, 4)
    return doubles(np.frombuffer(body, dtype=">f4", count=count, offset=8))


def blob(data: bytes) -> bytes:
    """Returns the body of an opaque message with `data`, padded to a multiple of four bytes."""
    return array(data + bytes(-len(data) % 4), len(data))


def to_blob(body: bytes) -> bytes:
    """Returns the data in the body of an opaque message. Raises FrameError if the body is invalid."""
    return body[8 : 8 + _count(body, 1)]


ACTUATOR = np.dtype([("position", ">f4"), ("speed", ">f4"), ("rest", ">f4", 2), ("state", ">u4")])


def actuators(position: Array, velocity: Array) -> bytes:
    """Returns the state of an actarray as bytes: positions [rad] and speeds [rad/s]."""
    found = np.zeros(len(position), dtype=ACTUATOR)
    found["position"], found["speed"] = position, velocity
    found["state"] = np.where(np.abs(velocity) > 1e-3, MOVING, IDLE)
    return array(found.tobytes(), len(position)) + struct.pack(">I", 1)


def to_actuators(body: bytes) -> tuple[Array, Array]:
    """Returns positions [rad] and speeds [rad/s] from the state of an actarray. Raises FrameError if the
    state is invalid."""
    found = np.frombuffer(body, dtype=ACTUATOR, count=_count(body, ACTUATOR.itemsize, rest=4), offset=8)
    return doubles(found["position"]), doubles(found["speed"])


def geometry(limits: Sequence[tuple[float, float, float, float]]) -> bytes:
    """Returns the geometry of an actarray, Player's interface to a group of joints, as bytes.

    Each joint has four values: its lowest, highest and initial position [rad], and its largest speed [rad/s].
    Player's values for lengths and axes of links are zero; clients get the links with the request FACTS.
    """
    joints = b"".join(
        struct.pack(">If6d5fI", ROTARY, 0.0, *([0.0] * 6), low, (low + high) / 2, high, home, speed, 0)
        for low, high, home, speed in limits
    )
    return array(joints, len(limits)) + struct.pack(">6d", *([0.0] * 6))


def devices(found: Sequence[tuple[int, int]], robot: int) -> bytes:
    """Returns the list of devices as bytes, with interface and index of each device. The number of devices is
    written twice, as Player and XDR require.
    """
    items = b"".join(struct.pack(">IIII", 0, robot, interface, index) for interface, index in found)
    return array(items, len(found))


def to_devices(body: bytes) -> list[tuple[int, int]]:
    """Decodes a list of devices: returns interface and index of each device. Raises FrameError if the bytes
    are invalid."""
    count = _count(body, 16)
    return [struct.unpack_from(">II", body, 16 + 16 * item) for item in range(count)]


def access(interface: int, index: int, mode: int, robot: int, driver: bytes = b"") -> bytes:
    """Returns the body of a request for access to a device, or of the answer, as bytes."""
    return struct.pack(">IIIII", 0, robot, interface, index, mode) + blob(driver)


def to_access(body: bytes) -> tuple[int, int, int]:
    """Reads a device's interface, index and access mode from the body of a request for access, or of its
    answer. Raises FrameError if the bytes are invalid."""
    if len(body) < 20:
        raise FrameError(f"Player: access to a device in {len(body)} bytes; valid: 20 and a name")
    interface, index, mode = struct.unpack_from(">III", body, 8)
    return interface, index, mode


FORMATS = {1: ">u1", 2: ">u2", 4: ">f4", 8: ">f8"}
"""Data type of a raw skin value for each number of bytes per channel."""


def skin(values: NDArray[np.generic]) -> bytes:
    """Returns raw skin values as bytes for an opaque message.

    Integers of one or two bytes stay integers; all other values become floats.
    """
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind not in "bu" or size > 2:
        size = 4 if (kind, size) == ("f", 4) else 8
    return values.astype(FORMATS[size]).tobytes()


def to_skin(data: bytes, channels: int) -> NDArray[np.generic]:
    """Returns the raw skin values (channels,) in the bytes of an opaque message.

    Raises FrameError if the number of bytes is not 1, 2, 4 or 8 for each channel.
    """
    size, rest = divmod(len(data), channels)
    if rest or size not in FORMATS:
        raise FrameError(f"skin of {channels} channels in {len(data)} bytes; valid: 1, 2, 4 or 8 for each")
    return np.frombuffer(data, dtype=FORMATS[size]).astype(FORMATS[size].replace(">", "<"))


def _count(body: bytes, size: int, rest: int = 0) -> int:
    """Returns the number of items in the array at the start of `body`. The array consists of this number,
    written twice, and the items of `size` bytes.

    Raises FrameError if the two numbers differ, or if fewer than `rest` bytes follow the array.
    """
    if len(body) < 8:
        raise FrameError(f"Player: an array in {len(body)} bytes; valid: 8 and its items")
    first, second = struct.unpack_from(">II", body)
    if first != second or 8 + first * size + rest > len(body):
        raise FrameError(
            f"Player: {first} and {second} items of {size} bytes declared, {len(body)} bytes there"
        )
    return int(first)
