"""Reads and writes ROS 2 messages as bytes in the encoding CDR (OMG DDS-RTPS, encapsulation CDR_LE).

Lengths in untrusted messages can't cause large allocations: each declared length is compared with the number
of remaining bytes before memory is allocated.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tci.errors import RecordingError

ENCAPSULATION = b"\x00\x01\x00\x00"
NUMBERS = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
SIZES = {item: struct.calcsize(form) for item, form in NUMBERS.items()}
DTYPES = {item: np.dtype("<" + form) for item, form in NUMBERS.items()}
STRUCTS = {item: struct.Struct("<" + form) for item, form in NUMBERS.items()}
HEADER = (("int32", "sec"), ("uint32", "nanosec"), ("string", "frame_id"))
"""Fields of `std_msgs/Header` and of its nested time. One list is enough, because CDR does not mark where a
nested message begins or ends."""
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
    """Message type that consists of numbers, strings, nested messages, and sequences of these."""

    name: str
    """Name in the form `package/msg/Name`."""
    fields: tuple[tuple[str, str], ...]
    """Type and name of each field after the header. A type with [] is a sequence."""
    says: str = ""
    """Comment at the top of the message's definition."""
    needs: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = ()
    """Nested messages by `package/Name`, with their fields. A field that is a nested message has the type
    `package/Name`, or `Name` where only one package has it."""
    headed: bool = True
    """True if the message begins with a `std_msgs/Header`."""

    @property
    def definition(self) -> str:
        """Returns the ROS definition, including nested messages, in the text format that other programs read
        from recordings."""
        lines = [f"# {line}" for line in self.says.splitlines()]
        lines += ["std_msgs/Header header"] if self.headed else []
        lines += [f"{kind} {name}" for kind, name in self.fields]
        for needed, fields in self.needs:
            lines += ["=" * 80, f"MSG: {needed}", *(f"{kind} {name}" for kind, name in fields)]
        return "\n".join(lines) + (HEADER_TEXT if self.headed else "\n")

    @property
    def flat(self) -> tuple[tuple[str, str], ...]:
        """Returns all fields, beginning with the fields of the header."""
        return HEADER + self.fields if self.headed else self.fields

    def inside(self, name: str) -> tuple[tuple[str, str], ...]:
        """Returns the fields of a nested message."""
        found = dict(self.needs)
        if name in found:
            return found[name]
        last = name.split("/")[-1]
        return next(fields for needed, fields in self.needs if needed.split("/")[-1] == last)


def encode(kind: MessageType, values: Sequence[Any]) -> bytes:
    """Returns the bytes of a message. The `values` are in the order of the message's fields; if the message
    has a header, `sec`, `nanosec` and `frame_id` come first."""
    out = bytearray()
    _fields(out, kind, kind.flat, values)
    return ENCAPSULATION + bytes(out)


def _fields(
    out: bytearray, kind: MessageType, fields: tuple[tuple[str, str], ...], values: Sequence[Any]
) -> None:
    for (type_, _), value in zip(fields, values, strict=True):
        item, many = item_of(type_)
        if many is None:
            _put(out, kind, item, value)
            continue
        if many == 0:
            _number(out, "uint32", len(value))
        elif len(value) != many:
            raise ValueError(f"{kind.name}: {len(value)} values for {type_}")
        if item == "string" and len(value):
            out += bytes(-len(out) % SIZES["uint32"]) + _texts(tuple(value))
        elif item not in NUMBERS:
            for inner in value:
                _put(out, kind, item, inner)
        elif len(value):
            out += bytes(-len(out) % SIZES[item])
            out += np.asarray(value, dtype=DTYPES[item]).tobytes()


@lru_cache(maxsize=1024)
def item_of(type_: str) -> tuple[str, int | None]:
    """Splits a field's type, such as `float64[9]`, into the type of one item and the number of items.

    The number is None for a single value, 0 for a sequence, and the length for an array.
    """
    item, bracket, rest = type_.partition("[")
    return item, int(rest.rstrip("]") or 0) if bracket else None


def decode(kind: MessageType, data: bytes) -> dict[str, Any]:
    """Returns the fields of a message by name. Numeric sequences are arrays, and nested messages are
    dictionaries.

    Raises RecordingError if the bytes do not fit the type.
    """
    # Some vendors store the number of padding bytes in the other two bytes.
    if data[:2] != ENCAPSULATION[:2]:
        raise RecordingError(f"{kind.name}: encapsulation {data[:4].hex()}; valid: {ENCAPSULATION.hex()}")
    return _read(_Reader(memoryview(data)[4:], kind.name), kind, kind.flat)


def _read(read: _Reader, kind: MessageType, fields: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for type_, name in fields:
        item, many = item_of(type_)
        if many is None:
            found[name] = _take(read, kind, item)
        elif item in NUMBERS:
            found[name] = read.numbers(item, many)
        elif item == "string" and not many:
            found[name] = read.texts(name)
        else:
            count = many or read.count(4 if item == "string" else 1)
            found[name] = [_take(read, kind, item) for _ in range(count)]
    return found


def _take(read: _Reader, kind: MessageType, item: str) -> Any:
    if item == "string":
        return read.text()
    return read.number(item) if item in NUMBERS else _read(read, kind, kind.inside(item))


def _number(out: bytearray, item: str, value: float) -> None:
    out += bytes(-len(out) % SIZES[item])
    out += STRUCTS[item].pack(value)


def _put(out: bytearray, kind: MessageType, item: str, value: Any) -> None:
    if item in NUMBERS:
        _number(out, item, value)
        return
    if item != "string":
        _fields(out, kind, kind.inside(item), value)
        return
    _text(out, value)


def _text(out: bytearray, value: str) -> None:
    text = value.encode("utf-8", "surrogateescape") + b"\0"
    _number(out, "uint32", len(text))
    out += text


@lru_cache(maxsize=64)
def _texts(values: tuple[str, ...]) -> bytes:
    """The items of a sequence. Names of joints come again in each message: encoding them anew took more than
    half of a JointState's 66 us on iCub."""
    out = bytearray()
    for value in values:
        _text(out, value)
    return bytes(out)


_BEFORE: dict[tuple[str, str], tuple[bytes, list[str]]] = {}
"""Bytes and texts of the sequence that was read last, by the name of the message and of its field."""


class _Reader:
    """Reads the bytes of one message from front to back."""

    def __init__(self, data: memoryview, name: str) -> None:
        self._data, self._name, self._at = data, name, 0

    def _take(self, length: int, align: int = 1) -> memoryview:
        begin = self._at + -self._at % align
        if length > len(self._data) - begin:
            raise RecordingError(f"{self._name}: {length} bytes declared, {len(self._data) - begin} there")
        self._at = begin + length
        return self._data[begin : self._at]

    def number(self, item: str) -> Any:
        form = STRUCTS[item]
        begin = self._at + -self._at % form.size
        try:
            [value] = form.unpack_from(self._data, begin)
        except struct.error:
            left = max(0, len(self._data) - begin)
            raise RecordingError(f"{self._name}: {form.size} bytes declared, {left} there") from None
        self._at = begin + form.size
        return value

    def count(self, least: int) -> int:
        """Reads the number of items of the sequence that follows in the message. Raises RecordingError if too
        few bytes remain for this number of items, each of at least `least` bytes."""
        count = int(self.number("uint32"))
        if count * least > len(self._data) - self._at:
            raise RecordingError(f"{self._name}: {count} items declared, too few bytes for them")
        return count

    def text(self) -> str:
        raw = bytes(self._take(self.count(1)))
        return raw.removesuffix(b"\0").decode("utf-8", "surrogateescape")

    def texts(self, field: str) -> list[str]:
        """Reads a sequence of texts. Most messages of a kind repeat it, such as the names of joints, so the
        bytes are compared with those of the message before."""
        begin = self._at + -self._at % 4
        raw, known = _BEFORE.get((self._name, field), (b"", []))
        if raw and self._data[begin : begin + len(raw)] == raw:
            self._at = begin + len(raw)
            return [*known]
        found = [self.text() for _ in range(self.count(4))]
        _BEFORE[self._name, field] = bytes(self._data[begin : self._at]), [*found]
        return found

    def numbers(self, item: str, many: int = 0) -> Any:
        """Reads numbers of the type `item`, for example `float64`. `many` is their number; with 0, the number
        is read from the message first."""
        size = SIZES[item]
        count = many or self.count(size)
        return np.frombuffer(self._take(count * size, size if count else 1), dtype=DTYPES[item])
