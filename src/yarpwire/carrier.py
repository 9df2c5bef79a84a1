"""Carriers: the formats in which messages travel on a connection."""

from __future__ import annotations

from dataclasses import dataclass

from yarpwire.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class Carrier:
    """One format for messages."""

    name: str
    code: int | None = None
    """Number that a binary header adds to its magic number; None for text."""
    acknowledged: bool = False
    """True if the receiver acknowledges each message."""
    greeting: str = ""
    """First word of a text connection."""


TCP = Carrier("tcp", code=131, acknowledged=True)
FAST_TCP = Carrier("fast_tcp", code=3)
UDP = Carrier("udp", code=0)
TEXT = Carrier("text", greeting="CONNECT ")
TEXT_ACK = Carrier("text_ack", acknowledged=True, greeting="CONNACK ")
CARRIERS = {carrier.name: carrier for carrier in (TCP, FAST_TCP, UDP, TEXT, TEXT_ACK)}
BY_CODE = {carrier.code: carrier for carrier in CARRIERS.values() if carrier.code is not None}


def find_carrier(name: str) -> Carrier:
    """Returns the carrier of that name, without its modifiers (`tcp+recv...`). Raises UnknownNameError."""
    plain = name.partition("+")[0]
    if plain not in CARRIERS:
        raise UnknownNameError("carrier", plain, CARRIERS)
    return CARRIERS[plain]
