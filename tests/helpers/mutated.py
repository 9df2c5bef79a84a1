"""Damaged messages for all readers of untrusted bytes."""

from __future__ import annotations

import random
import struct


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Returns `data` with changed bytes, a cut or doubled piece, or an extreme integer in its middle."""
    spoiled = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(spoiled) + 1)
        match chance.randrange(5):
            case 0:
                spoiled[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                del spoiled[at : at + chance.randint(1, 9)]
            case 2:
                spoiled[at : at + 4] = struct.pack("<i", chance.choice([-1, 2**31 - 1, 256, 0, 65536]))
            case 3:
                spoiled[at:at] = spoiled[at : at + 16]
            case 4:
                del spoiled[at:]
    return bytes(spoiled)
