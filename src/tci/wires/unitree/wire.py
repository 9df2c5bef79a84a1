"""Unitree's messages as bytes: encoding, decoding and the checksum.

Unitree computes the checksum over a C struct. Some padding bytes of the struct are missing in the transmitted
bytes (CDR). Therefore this module stores messages as NumPy records with the layout of the C structs. The
functions `encode_*` remove the padding that is not transmitted.
"""

from __future__ import annotations

import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError

HEAD = b"\0\1\0\0"
"""First bytes of each message, which identify little-endian CDR."""
SLOTS = 35
"""Number of slots for motors in a message. A G1 uses at most 29 slots."""
WEIGHT = 29
"""Index of a slot without a motor. In a message of rt/arm_sdk, the field `q` of this slot contains the
weight: with 0, the motors follow only the robot's own controller, with 1 only the message's targets."""
TAXELS = 12
"""Number of values that one press sensor measures."""
MOST_ITEMS = 64
"""Largest number of motors or press sensors of a hand, to bound the used memory. Assumed: hands have far
fewer; a Dex3 has 7 motors and 9 press sensors."""


def _record(size: int, **fields: tuple[Any, int]) -> np.dtype[np.void]:
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": size})


MOTOR_COMMAND = _record(
    28, mode=("u1", 0), q=("<f4", 4), dq=("<f4", 8), tau=("<f4", 12), kp=("<f4", 16), kd=("<f4", 20),
    reserve=("<u4", 24),
)  # fmt: skip
COMMAND = _record(
    1004, mode_pr=("u1", 0), mode_machine=("u1", 1), motor=((MOTOR_COMMAND, SLOTS), 4),
    reserve=(("<u4", 4), 984), crc=("<u4", 1000),
)  # fmt: skip
"""LowCmd_, the message of rt/lowcmd and rt/arm_sdk. A motor's torque is tau + kp (q - q_now) + kd (dq -
dq_now)."""
MOTOR_STATE = _record(
    56, mode=("u1", 0), q=("<f4", 4), dq=("<f4", 8), ddq=("<f4", 12), tau_est=("<f4", 16),
    temperature=(("<i2", 2), 20), vol=("<f4", 24), sensor=(("<u4", 2), 28), motorstate=("<u4", 36),
    reserve=(("<u4", 4), 40),
)  # fmt: skip
STATE = _record(
    2092, version=(("<u4", 2), 0), mode_pr=("u1", 8), mode_machine=("u1", 9), tick=("<u4", 12),
    quaternion=(("<f4", 4), 16), gyroscope=(("<f4", 3), 32), accelerometer=(("<f4", 3), 44),
    rpy=(("<f4", 3), 56), temperature=("<i2", 68), motor=((MOTOR_STATE, SLOTS), 72),
    remote=(("u1", 40), 2032), reserve=(("<u4", 4), 2072), crc=("<u4", 2088),
)  # fmt: skip
"""LowState_, the message of rt/lowstate."""
PRESS = _record(
    104, pressure=(("<f4", TAXELS), 0), temperature=(("<f4", TAXELS), 48), lost=("<u4", 96),
    reserve=("<u4", 100),
)  # fmt: skip
"""PressSensorState_, the state of one press sensor in a hand's message."""
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def checksum(data: bytes) -> int:
    """Returns Unitree's checksum of 32-bit words: CRC-32/MPEG-2 with the bytes of each word in reverse order.

    `zlib` computes the CRC with the mirrored polynomial. Therefore the bits are mirrored before and after.
    """
    mirrored = np.frombuffer(data, "<u4").byteswap().tobytes().translate(_REVERSED)
    return int(f"{zlib.crc32(mirrored) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def encode_command(command: NDArray[np.void]) -> bytes:
    """Encodes `command`, a record of the NumPy type COMMAND, as the bytes of a message with the checksum."""
    data = command.tobytes()
    return b"".join((HEAD, data[:2], data[4:6], data[8:1000], checksum(data[:1000]).to_bytes(4, "little")))


def encode_state(state: NDArray[np.void]) -> bytes:
    """Returns a record of STATE as the bytes of a message, with the checksum."""
    data = state.tobytes()
    ends = checksum(data[:2088]).to_bytes(4, "little")
    return b"".join((HEAD, data[:70], data[72:74], data[76:2088], ends))


def decode_command(data: bytes) -> tuple[Any, bool]:
    """Returns the command in a message, as a record with the fields of `COMMAND`, and True if the message's
    checksum is right. Raises FrameError if the message is invalid."""
    body = _body(data, COMMAND, "a command")
    return _judged(b"".join((body[:2], b"\0\0", body[2:4], b"\0\0", body[4:])), COMMAND)


def decode_state(data: bytes) -> tuple[Any, bool]:
    """Returns the robot's state from a message, as a record of type `STATE`, and True if the message's
    checksum is right. Raises FrameError if the message is invalid."""
    body = _body(data, STATE, "a state")
    return _judged(b"".join((body[:70], b"\0\0", body[70:72], b"\0\0", body[72:])), STATE)


def _body(data: bytes, kind: np.dtype[np.void], what: str) -> bytes:
    size = kind.itemsize - 4  # in both kinds of message, 4 padding bytes are not transmitted
    if data[:4] != HEAD or len(data) != size + 4:
        found = f"{len(data)} bytes that begin with {data[:4].hex()}"
        raise FrameError(f"{what} of Unitree: {found}; valid: {size + 4} that begin with {HEAD.hex()}")
    return data[4:]


def _judged(struct: bytes, kind: np.dtype[np.void]) -> tuple[Any, bool]:
    found = np.frombuffer(struct, kind)[0]
    return found, checksum(struct[:-4]) == int(found["crc"])


class HandState(NamedTuple):
    """State of one Dex3 hand."""

    motors: NDArray[np.void]
    """States of the motors (m,), as records MOTOR_STATE."""
    pads: NDArray[np.void]
    """States of the press sensors (p,): records with the fields `pressure`, `temperature`, `lost` and
    `reserve`."""
    errors: NDArray[np.uint32]
    """Error codes (2,) that the hand reports; 0 means no error."""


def decode_hand(data: bytes) -> HandState:
    """Returns the state of a hand. Raises FrameError if the message is invalid."""
    motors, at = _items(data, 4, MOTOR_STATE, "motors")
    pads, at = _items(data, at, PRESS, "press sensors")
    if len(data) < at + HAND_REST:
        raise FrameError(f"a hand's state of {len(data)} bytes; valid: {at + HAND_REST}")
    return HandState(motors, pads, np.frombuffer(data, "<u4", 2, at + HAND_REST - 16))


def _items(data: bytes, at: int, kind: np.dtype[np.void], what: str) -> tuple[NDArray[np.void], int]:
    count = int.from_bytes(data[at : at + 4], "little")
    end = at + 4 + count * kind.itemsize
    if data[:4] != HEAD or count > MOST_ITEMS or end > len(data):
        raise FrameError(
            f"a hand's state of {len(data)} bytes with {count} {what}; valid: at most {MOST_ITEMS}, "
            "and as many bytes as they need"
        )
    return np.frombuffer(data, kind, count, at + 4), end


def encode_hand(motors: NDArray[np.void], pads: NDArray[np.void]) -> bytes:
    """Returns the state of a hand as the bytes of a message. All fields after motors and press sensors are
    zero."""
    parts = (HEAD, *(len(items).to_bytes(4, "little") + items.tobytes() for items in (motors, pads)))
    return b"".join((*parts, bytes(HAND_REST)))


def encode_hand_command(motors: NDArray[np.void]) -> bytes:
    """Returns the bytes of a message that commands a hand. `motors` (m,) are records of type `MOTOR_COMMAND`,
    one per motor."""
    return b"".join((HEAD, len(motors).to_bytes(4, "little"), motors.tobytes(), bytes(16)))


def decode_hand_command(data: bytes) -> NDArray[np.void]:
    """Returns the commands (m,) to the m motors of a hand, as records of MOTOR_COMMAND. Raises FrameError if
    the message is invalid."""
    return _items(data, 4, MOTOR_COMMAND, "motors")[0]


HAND_REST = 56 + 16 + 16
"""Number of bytes after the press sensors: IMUState_ (54, padded to 56), voltages and currents (16), errors
and reserve (16)."""
