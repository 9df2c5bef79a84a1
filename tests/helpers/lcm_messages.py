"""The messages of `remote_messages` in LCM's encoding, and LCM's datagrams."""

from __future__ import annotations

from helpers.remote_messages import FRAME, NAO, ORDERS, STATE
from tci.wires.lcm.encoding import (
    frame_bytes,
    orders_bytes,
    state_bytes,
    to_orders,
    to_skin,
    to_state,
)

WHOLE = [
    (to_state, STATE, state_bytes(NAO, STATE)),
    (to_skin, FRAME, frame_bytes(NAO, FRAME)),
    (to_orders, ORDERS, orders_bytes(NAO, ORDERS)),
]


def short(number: int, channel: bytes = b"c", body: bytes = b"body") -> bytes:
    return b"LC02" + number.to_bytes(4, "big") + channel + b"\0" + body


def pieces(number: int, body: bytes, count: int) -> list[bytes]:
    step = -(-len(body) // count)
    made = []
    for place in range(count):
        head = b"LC03" + number.to_bytes(4, "big") + len(body).to_bytes(4, "big")
        head += (place * step).to_bytes(4, "big") + place.to_bytes(2, "big") + count.to_bytes(2, "big")
        made.append(head + (b"c\0" if place == 0 else b"") + body[place * step : (place + 1) * step])
    return made
