"""Bottles (lists of items) and Vectors (arrays of doubles) as bytes, in both dialects.

- A Bottle is: int32 256|subtag, int32 count, and the items. The subtag is the tag of all items if they have
  one primitive type, otherwise 0.
- An item is its int32 tag and its value. In a Bottle with a subtag, items have no tags.
- A Vector is: int32 256|float64, int32 count, and the doubles.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarpwire.dialect import DIALECTS, Dialect
from yarpwire.errors import WireError
from yarpwire.source import Memory, Source
from yarpwire.values import (
    FALSE,
    TRUE,
    Array,
    Dict,
    Float32,
    Int8,
    Int16,
    Int64,
    Loose,
    Value,
    Vocab,
    Vocab64,
)

LIST, DICT = 256, 512
GROUP = LIST | DICT
DEEPEST = 32
"""Deepest nesting of lists that is read. Assumed: YARP's own messages nest a few levels; deeper data is
malicious or damaged."""

INT8, INT16, INT32, INT64, VOCAB32, STRING, BLOB = 32, 64, 1, 17, 9, 4, 12
PACKS: dict[type, tuple[int, str]] = {
    Int8: (INT8, "b"), Int16: (INT16, "h"), Int64: (INT64, "q"), Vocab: (VOCAB32, "i"),
}  # fmt: skip
WORD, HEAD = struct.Struct("<i"), struct.Struct("<ii")
DOUBLE = np.dtype("<f8")


def _formats(dialect: Dialect) -> dict[int, tuple[str, int, type]]:
    formats: dict[int, tuple[str, int, type]] = {
        INT8: ("b", 1, Int8), INT16: ("h", 2, Int16), INT32: ("i", 4, int), INT64: ("q", 8, Int64),
        VOCAB32: ("i", 4, Vocab), dialect.float64: ("d", 8, float), dialect.float32: ("f", 4, Float32),
    }  # fmt: skip
    if dialect.vocab64 is not None:
        formats[dialect.vocab64] = ("q", 8, Vocab64)
    return formats


FORMATS = {name: _formats(dialect) for name, dialect in DIALECTS.items()}


def encode_bottle(items: Sequence[Any] | NDArray[Any], dialect: Dialect) -> bytes:
    """Returns a Bottle as bytes. Raises WireError if a Bottle can't hold a value."""
    sub, body = _body(items, dialect)
    return WORD.pack(LIST | sub) + body


def encode_vector(values: Array, dialect: Dialect) -> tuple[bytes, bytes]:
    """Returns the two blocks that YARP sends for a Vector: its head, and its numbers (n,) as doubles."""
    return HEAD.pack(LIST | dialect.float64, len(values)), np.asarray(values, DOUBLE).tobytes()


def decode_bottle(data: bytes, dialect: Dialect) -> list[Any]:
    """Returns the items of a Bottle. Raises WireError if `data` is not exactly one Bottle."""
    source = Memory(data)
    items = read_bottle(source, dialect)
    if source.left():
        raise WireError(
            f"{source.left()} bytes after the Bottle of YARP {dialect.name}; {_hint(data, dialect)}"
        )
    return items


def read_bottle(source: Source, dialect: Dialect) -> list[Any]:
    """Reads a Bottle up to its last byte and no further. So this function can also read a reply, which does
    not contain its own length."""
    code = _word(source)
    if code & LIST == 0 or code < 0:
        raise WireError(f"a Bottle begins with {code}; valid: {LIST} + the tag of its items")
    return _items(source, code & ~GROUP, dialect, DEEPEST)


def decode_vector(data: bytes, dialect: Dialect) -> NDArray[np.float64]:
    """Returns the numbers (n,) of a Vector. Raises WireError if `data` is not a Vector of this dialect. The
    usual cause is a Vector of the other dialect."""
    if len(data) < 8:
        raise WireError(f"a Vector of {len(data)} bytes; valid: 8 + 8 per number")
    code, count = HEAD.unpack_from(data)
    if code != LIST | dialect.float64 or len(data) != 8 + 8 * count:
        raise WireError(
            f"{len(data)} bytes with tag {code} and count {count} are no Vector of YARP {dialect.name}; "
            + _hint(data, dialect)
        )
    return np.frombuffer(data, DOUBLE, -1, 8)


def dialect_of_vector(data: bytes) -> Dialect | None:
    """Returns the dialect in which `data` is a Vector of doubles. Returns None if `data` is not a Vector, or
    is an empty Vector."""
    if len(data) <= 8:
        return None
    code, count = HEAD.unpack_from(data)
    if len(data) != 8 + 8 * count:
        return None
    return next((dialect for dialect in DIALECTS.values() if code == LIST | dialect.float64), None)


def _hint(data: bytes, dialect: Dialect) -> str:
    other = dialect_of_vector(data)
    if other is not None and other is not dialect:
        return f"they are one of YARP {other.name}: choose that dialect"
    return "a peer of the other dialect, or a damaged message"


def _word(source: Source) -> int:
    word: int = WORD.unpack(source.take(4))[0]
    return word


def _items(source: Source, sub: int, dialect: Dialect, deepest: int) -> list[Any]:
    count = _word(source)
    formats = FORMATS[dialect.name]
    if sub in formats:
        format, size, kind = formats[sub]
        if count < 0 or count * size > source.left():
            raise WireError(f"a list of {count} items; valid: 0 to {source.left() // size}")
        values = struct.unpack(f"<{count}{format}", source.take(count * size))
        return list(values) if kind in (int, float) else [kind(value) for value in values]
    if count < 0 or count * 4 > source.left():
        raise WireError(f"a list of {count} items; valid: 0 to {source.left() // 4}")
    if sub:
        return [_value(source, sub, dialect, deepest) for _ in range(count)]
    items = [_value(source, _word(source), dialect, deepest) for _ in range(count)]
    same = len({type(item) for item in items}) == 1 and not isinstance(items[0], list)
    return Loose(items) if same else items


def _value(source: Source, tag: int, dialect: Dialect, deepest: int) -> Value:
    if tag in (STRING, BLOB):
        data = source.take(_word(source))
        return data.decode("utf-8", errors="surrogateescape") if tag == STRING else data
    known = FORMATS[dialect.name].get(tag)
    if known is not None:
        format, size, kind = known
        value: Value = kind(struct.unpack(f"<{format}", source.take(size))[0])
        return value
    if tag < 0 or tag & GROUP == 0:
        raise WireError(f"tag {tag} is none of YARP {dialect.name}")
    if deepest == 0:
        raise WireError(f"lists nested deeper than {DEEPEST}")
    items = _items(source, tag & ~GROUP, dialect, deepest - 1)
    return Dict(items) if tag & DICT else items


def _body(items: Sequence[Any] | NDArray[Any], dialect: Dialect) -> tuple[int, bytes]:
    """Returns the tag (the number of a type) that all items have in common, or 0 if their tags differ, and
    the number of items and their values as bytes."""
    if isinstance(items, np.ndarray):
        if items.dtype == DOUBLE and items.ndim == 1 and items.size:
            return dialect.float64, WORD.pack(len(items)) + items.tobytes()
        items = items.tolist()
    if items and not isinstance(items, Loose) and all(type(item) is float for item in items):
        return dialect.float64, struct.pack(f"<i{len(items)}d", len(items), *items)
    packed = [_pack(item, dialect) for item in items]
    tags = {tag for tag, _ in packed}
    sub = tags.pop() if len(tags) == 1 and not isinstance(items, Loose) else 0
    if sub & GROUP:
        sub = 0
    parts = [WORD.pack(len(items))]
    for tag, data in packed:
        parts += [data] if sub else [WORD.pack(tag), data]
    return sub, b"".join(parts)


def _pack(item: Any, dialect: Dialect) -> tuple[int, bytes]:
    try:
        if isinstance(item, bool | np.bool_):
            item = TRUE if item else FALSE
        elif isinstance(item, np.integer | np.floating):
            item = item.item()
        kind = type(item)
        if kind in PACKS:
            tag, format = PACKS[kind]
            return tag, struct.pack(f"<{format}", item)
        if kind is Vocab64 and dialect.vocab64 is not None:
            return dialect.vocab64, struct.pack("<q", item)
        if kind is int:
            small = -(1 << 31) <= item < 1 << 31
            return (INT32, WORD.pack(item)) if small else (INT64, struct.pack("<q", item))
        if kind is float:
            return dialect.float64, struct.pack("<d", item)
        if kind is Float32:
            return dialect.float32, struct.pack("<f", item)
    except (struct.error, OverflowError) as error:
        raise WireError(f"{item!r} does not fit its type: {error}") from None
    if isinstance(item, str | bytes):
        data = item.encode("utf-8", errors="surrogateescape") if isinstance(item, str) else item
        return STRING if isinstance(item, str) else BLOB, WORD.pack(len(data)) + data
    if isinstance(item, list | tuple | np.ndarray):
        sub, body = _body(item, dialect)
        return LIST | (DICT if isinstance(item, Dict) else 0) | sub, body
    raise WireError(f"a Bottle of YARP {dialect.name} can't hold {item!r}")
