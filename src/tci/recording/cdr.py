"""ROS 2 messages as bytes: the flat part of CDR (OMG DDS-RTPS, encapsulation CDR_LE).

Decoding is bounded: a declared length is checked against the bytes that are there before anything is
allocated.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tci.errors import RecordingError

ENCAPSULATION = b"\x00\x01\x00\x00"
NUMBERS = {
    "bool": "?", "uint8": "B", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "float64": "d"
}  # fmt: skip
SIZES = {item: struct.calcsize(form) for item, form in NUMBERS.items()}
DTYPES = {item: np.dtype("<" + form) for item, form in NUMBERS.items()}
STRUCTS = {item: struct.Struct("<" + form) for item, form in NUMBERS.items()}
HEADER = (("int32", "sec"), ("uint32", "nanosec"), ("string", "frame_id"))
"""`std_msgs/Header`, flat: CDR has no mark around a nested message."""
HEADER_TEXT = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message of numbers, texts and sequences of them."""

    name: str
    """`package/msg/Name`."""
    fields: tuple[tuple[str, str], ...]
    """Type and name of each field; a type with [] is a sequence. A header comes first and flat."""
    says: str = ""
    """Comment at the head of the definition."""
    needs: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = ()
    """Messages inside it, by `package/Name`, with their fields; used by the last part of that name."""

    @property
    def definition(self) -> str:
        """The ROS definition with those that it needs, as other programs read it from the file."""
        lines = [f"# {line}" for line in self.says.splitlines()]
        lines += ["std_msgs/Header header", *(f"{kind} {name}" for kind, name in self.fields)]
        for needed, fields in self.needs:
            lines += ["=" * 80, f"MSG: {needed}", *(f"{kind} {name}" for kind, name in fields)]
        return "\n".join(lines) + HEADER_TEXT

    @property
    def flat(self) -> tuple[tuple[str, str], ...]:
        """All fields with those of the header."""
        return HEADER + self.fields

    def inside(self, name: str) -> tuple[tuple[str, str], ...]:
        """The fields of a message inside this one."""
        return next(fields for needed, fields in self.needs if needed.endswith(f"/{name}"))


def encode(kind: MessageType, values: Sequence[Any]) -> bytes:
    """The bytes of a message; `values` in the order of `MessageType.flat`."""
    out = bytearray()
    _fields(out, kind, kind.flat, values)
    return ENCAPSULATION + bytes(out)


def _fields(
    out: bytearray, kind: MessageType, fields: tuple[tuple[str, str], ...], values: Sequence[Any]
) -> None:
    for (type_, _), value in zip(fields, values, strict=True):
        item = type_.removesuffix("[]")
        if item == type_:
            _put(out, item, value)
            continue
        _number(out, "uint32", len(value))
        if item == "string":
            for text in value:
                _put(out, "string", text)
        elif item not in NUMBERS:
            for inner in value:
                _fields(out, kind, kind.inside(item), inner)
        elif len(value):
            out += bytes(-len(out) % SIZES[item])
            out += np.asarray(value, dtype=DTYPES[item]).tobytes()


def decode(kind: MessageType, data: bytes) -> dict[str, Any]:
    """The fields of a message by name; sequences of numbers as arrays. Raises RecordingError."""
    if data[:4] != ENCAPSULATION:
        raise RecordingError(f"{kind.name}: encapsulation {data[:4].hex()}; valid: {ENCAPSULATION.hex()}")
    read = _Reader(memoryview(data)[4:], kind.name)
    found: dict[str, Any] = {}
    for type_, name in kind.flat:
        item = type_.removesuffix("[]")
        if item == type_:
            found[name] = read.text() if item == "string" else read.number(item)
        elif item == "string":
            count = read.count(4)
            found[name] = [read.text() for _ in range(count)]
        else:
            found[name] = read.numbers(item)
    return found


def _number(out: bytearray, item: str, value: float) -> None:
    out += bytes(-len(out) % SIZES[item])
    out += STRUCTS[item].pack(value)


def _put(out: bytearray, item: str, value: Any) -> None:
    if item != "string":
        _number(out, item, value)
        return
    text = value.encode("utf-8", "surrogateescape") + b"\0"
    _number(out, "uint32", len(text))
    out += text


class _Reader:
    """A place in the bytes of one message."""

    def __init__(self, data: memoryview, name: str) -> None:
        self._data, self._name, self._at = data, name, 0

    def _take(self, length: int, align: int = 1) -> memoryview:
        begin = self._at + -self._at % align
        if length > len(self._data) - begin:
            raise RecordingError(f"{self._name}: {length} bytes declared, {len(self._data) - begin} there")
        self._at = begin + length
        return self._data[begin : self._at]

    def number(self, item: str) -> Any:
        return STRUCTS[item].unpack(self._take(SIZES[item], SIZES[item]))[0]

    def count(self, least: int) -> int:
        """A declared count of things of at least `least` bytes each."""
        count = int(self.number("uint32"))
        if count * least > len(self._data) - self._at:
            raise RecordingError(f"{self._name}: {count} items declared, too few bytes for them")
        return count

    def text(self) -> str:
        raw = bytes(self._take(self.count(1)))
        return raw.removesuffix(b"\0").decode("utf-8", "surrogateescape")

    def numbers(self, item: str) -> Any:
        size = SIZES[item]
        count = self.count(size)
        return np.frombuffer(self._take(count * size, size if count else 1), dtype=DTYPES[item])
