"""Captured connections between programs of real YARP 3.12.3 and 4.0, as lists of (direction, bytes)."""

from __future__ import annotations

import json
from functools import cache

from helpers import TESTS
from yarpwire.dialect import V3, V4, Dialect

FILE = TESTS / "yarpwire" / "data" / "captures.json"
NAMES = ("v4rpc", "v4tcp", "v4fast_tcp", "v4text", "v4text_ack", "st3", "st4", "nwc3", "devreg")
DIALECTS: dict[str, Dialect] = {name: V3 if name in ("st3", "nwc3") else V4 for name in NAMES}
Connection = list[tuple[str, bytes]]


@cache
def flows() -> dict[str, list[Connection]]:
    return {
        name: [[(m["dir"], bytes.fromhex(m["hex"])) for m in one["messages"]] for one in connections]
        for name, connections in json.loads(FILE.read_text()).items()
    }


def said(connection: Connection, direction: str) -> bytes:
    return b"".join(data for way, data in connection if way == direction)


def binary(name: str) -> list[Connection]:
    return [one for one in flows()[name] if one and one[0][1][:2] == b"YA"]


def textual(name: str) -> list[Connection]:
    return [one for one in flows()[name] if one and one[0][1][:4] == b"CONN"]


def naming(name: str) -> list[Connection]:
    return [one for one in flows()[name] if one and one[0][1].startswith(b"NAME_SERVER")]
