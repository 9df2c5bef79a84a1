"""Names that the driver and the server of a NAO both use: ALMemory keys, and skin frames as text.

A patch of skin is one vector of numbers in ALMemory. The vector's key is `TCI/Skin/PATCH`, or the key in the
description's binding to NAOqi. Each switch has a key of its own; the binding lists these keys, separated by
spaces.

The library `qi` needs about 6 ms to transfer a vector of 720 numbers, but only 0.3 ms to transfer these
numbers as text. Therefore a program that publishes the patch may also write the frame as text, under the key
`KEY/Packed`. The text is `SEQUENCE TYPE BASE64`, with little-endian numbers.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.robot.description import Binding, Robot

MIDDLEWARE = "naoqi"
CYCLE = 0.02
"""ALMotion's own period [s] (Aldebaran's documentation of ALMotion, 50 Hz)."""
TYPES: dict[str, np.dtype[Any]] = {"u1": np.dtype("u1"), "i4": np.dtype("<i4"), "f4": np.dtype("<f4")}
"""Types of the values in a packed frame, by their name in the text of the frame."""
LONGEST = 1_000_000
"""Length [characters] of the longest packed frame that is decoded."""
REFUSED = object()
"""Marker that replaces the value of a key if NAOqi refuses the request."""
_PACKED = re.compile(r"([0-9]{1,18}) (u1|i4|f4) ([A-Za-z0-9+/]*={0,2})")


def skin_keys(robot: Robot, binding: Binding) -> dict[str, tuple[str, ...]]:
    """Returns the ALMemory keys by the name of the patch: one key for the patch, or one key per channel, as
    for NAO's switches."""
    return {
        patch.name: tuple(binding.address(patch.name, f"TCI/Skin/{patch.name}").split(" "))
        for patch in robot.skin
    }


def packed_key(key: str) -> str:
    """Returns the ALMemory key under which a skin frame is stored as text. `key` is the key of the frame as a
    vector of numbers."""
    return f"{key}/Packed"


def sequence_key(key: str) -> str:
    """Returns the key of the sequence number of the frame at `key`. This number increases by one per
    frame. ALMemory may lack the key."""
    return f"{key}/Sequence"


def find_keys(keys: Mapping[str, tuple[str, ...]], attempt: Callable[[str], Any]) -> dict[str, list[str]]:
    """Finds the keys to request for each patch.

    The first choice is the frame as text. The second choice is the vector together with the key of the
    sequence number, and the third choice is the vector alone. For a patch of switches, the keys of all its
    switches are requested.

    `attempt` requests a single key, since some NAOqi versions refuse a whole list of keys if one key is
    missing. `attempt` returns the value of the key, None if there is no value, or the marker REFUSED if NAOqi
    refuses the request.
    """
    asks = {}
    for patch, names in keys.items():
        if len(names) == 1 and isinstance(attempt(packed_key(names[0])), str):
            asks[patch] = [packed_key(names[0])]
            continue
        there = [key for key in names if attempt(key) is not REFUSED]
        if len(names) == 1 and there and isinstance(attempt(sequence_key(names[0])), int):
            there.append(sequence_key(names[0]))
        if len(there) >= len(names):
            asks[patch] = there
    return asks


def angle_key(servo: str, side: str) -> str:
    """Returns ALMemory's key for a servo's angle: `side` is `Sensor` for the measured angle or `Actuator` for
    the commanded angle."""
    return f"Device/SubDeviceList/{servo}/Position/{side}/Value"


def current_key(servo: str) -> str:
    """Returns ALMemory's key for the current [A] of a servo's motor."""
    return f"Device/SubDeviceList/{servo}/ElectricCurrent/Sensor/Value"


def pack(sequence: int, values: NDArray[np.generic]) -> str:
    """Returns a frame (channels,) as text."""
    kind = "u1" if values.dtype == np.uint8 else "i4" if values.dtype.kind in "iu" else "f4"
    return f"{sequence} {kind} {base64.b64encode(values.astype(TYPES[kind]).tobytes()).decode()}"


def unpack(text: str, channels: int) -> tuple[int, NDArray[np.generic]]:
    """Returns the sequence number and the values (channels,) of a packed frame.

    Raises FrameError if `text` is not a packed frame of this size. The length is checked before memory is
    allocated.
    """
    found = _PACKED.fullmatch(text) if len(text) <= LONGEST else None
    if found is None:
        raise FrameError(f"packed frame {text[:40]!r}; valid: SEQUENCE u1|i4|f4 BASE64")
    kind = TYPES[found[2]]
    if len(found[3]) != 4 * -(-channels * kind.itemsize // 3):
        raise FrameError(f"packed frame of {len(found[3])} characters; {channels} values belong in it")
    try:
        data = base64.b64decode(found[3], validate=True)
    except binascii.Error as error:
        raise FrameError(f"packed frame: {error}") from error
    values = np.frombuffer(data, dtype=kind) if len(data) == channels * kind.itemsize else None
    if values is None:
        raise FrameError(f"packed frame of {len(data)} bytes; valid: {channels * kind.itemsize}")
    return int(found[1]), values
