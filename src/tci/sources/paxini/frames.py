"""What PaXini's boards have in common: frames with a checksum, and three forces at each point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

REQUEST = b"\x55\xaa"
ANSWER = b"\xaa\x55"
BAUD = 921_600
POINT = 3
"""Bytes of a point: forces along x and y, signed, and z, unsigned, in steps of 0.1 N."""


def with_checksum(frame: bytes) -> bytes:
    """The sum of all bytes, modulo 256, becomes 0."""
    return frame + bytes((-sum(frame) & 0xFF,))


def points(data: bytes) -> NDArray[np.int16]:
    """(n, 3) forces [0.1 N] along the axes of each point, z outwards."""
    raw = np.frombuffer(data, np.uint8).reshape(-1, POINT)
    return np.stack([raw[:, 0].view(np.int8), raw[:, 1].view(np.int8), raw[:, 2]], axis=1).astype(np.int16)
