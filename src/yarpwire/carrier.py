"""Carriers. A carrier is the format of the messages on a connection."""

from __future__ import annotations

from dataclasses import dataclass

from yarpwire.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class Carrier:
    """One format for messages."""

    name: str
    code: int | None = None
    """Number of the carrier. A binary header contains 7777 plus this number. The value is None for text
    carriers."""
    acknowledged: bool = False
    """True if the receiver acknowledges each message."""
    greeting: str = ""
    """First word that is sent on a text connection. The text is empty for binary carriers."""


TCP = Carrier("tcp", code=131, acknowledged=True)
FAST_TCP = Carrier("fast_tcp", code=3)
UDP = Carrier("udp", code=0)
TEXT = Carrier("text", greeting="CONNECT ")
TEXT_ACK = Carrier("text_ack", acknowledged=True, greeting="CONNACK ")
CARRIERS = {carrier.name: carrier for carrier in (TCP, FAST_TCP, UDP, TEXT, TEXT_ACK)}
BY_CODE = {carrier.code: carrier for carrier in CARRIERS.values() if carrier.code is not None}


def find_carrier(name: str) -> Carrier:
    """Returns the carrier with this name; modifiers (`tcp+recv...`) are ignored. Raises UnknownNameError if
    no carrier has this name."""
    plain = name.partition("+")[0]
    if plain not in CARRIERS:
        raise UnknownNameError("carrier", plain, CARRIERS)
    return CARRIERS[plain]
