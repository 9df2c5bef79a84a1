"""Bottles and messages: invalid data are refused, and accepted data keep their meaning."""

from __future__ import annotations

import contextlib
import os
import random
import struct
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.mutated import mutated
from helpers.yarp_captures import DIALECTS, binary
from yarpwire import message
from yarpwire.bottle import decode_bottle, decode_vector, encode_bottle, encode_vector
from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import WireError
from yarpwire.source import Memory
from yarpwire.text import from_text, to_text
from yarpwire.values import Dict, Float32, Int8, Int16, Int64, Vocab, Vocab64

letters = st.text("abcdefghijklmnopqrstuvwxyz", min_size=1, max_size=4)
plain = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(max_size=12),
    st.binary(max_size=8),
    letters.map(Vocab),
)
typed = st.one_of(
    plain,
    st.integers(-128, 127).map(Int8),
    st.integers(-(2**15), 2**15 - 1).map(Int16),
    st.floats(width=32, allow_nan=False).map(Float32),
)


def lists(items: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.lists(st.recursive(items, lambda inner: st.lists(inner, max_size=4), max_leaves=12), max_size=6)


@given(lists(typed), st.sampled_from([V3, V4]))
def test_what_is_encoded_is_decoded(items: list[Any], dialect: Dialect) -> None:
    data = encode_bottle(items, dialect)
    assert decode_bottle(data, dialect) == items
    assert encode_bottle(decode_bottle(data, dialect), dialect) == data


@given(lists(plain))
def test_text_says_the_same(items: list[Any]) -> None:
    assert to_text(from_text(to_text(items))) == to_text(items)


def test_types_that_only_the_wire_knows() -> None:
    items = [Vocab64("setposit"), Dict([["gain", 2.0]]), Int64(3), True, np.float64(1.5), np.int64(7)]
    decoded = decode_bottle(encode_bottle(items, V4), V4)
    assert [type(item) for item in decoded] == [Vocab64, Dict, Int64, Vocab, float, int]
    assert to_text(decoded) == "[setposit] ((gain 2.0)) 3 true 1.5 7"
    with pytest.raises(WireError, match="YARP 3 can't hold"):
        encode_bottle([Vocab64("setposit")], V3)


@pytest.mark.parametrize(("written", "read"), [(V3, V4), (V4, V3)])
@pytest.mark.parametrize("count", [1, 2, 7, 16, 768])
def test_no_dialect_passes_for_the_other(written: Dialect, read: Dialect, count: int) -> None:
    values = np.linspace(-1.0, 255.0, count)
    data = b"".join(encode_vector(values, written))
    with pytest.raises(WireError, match=f"one of YARP {written.name}"):
        decode_vector(data, read)
    with pytest.raises(WireError, match=f"one of YARP {written.name}|tag|valid"):
        decode_bottle(data, read)
    with pytest.raises(WireError):
        decode_bottle(encode_bottle(["state", values], written), read)


@pytest.mark.parametrize("length", [-1, 2**31 - 1, -(2**31), 2**24])
def test_31_a_length_that_is_not_there_is_refused_before_memory_is_taken(length: int) -> None:
    word = struct.pack("<i", length)
    hostile = {
        "string": struct.pack("<ii", 256 | 4, 1) + word,
        "blob": struct.pack("<iii", 256, 1, 12) + word,
        "doubles": struct.pack("<i", 256 | 10) + word,
        "list": struct.pack("<i", 256) + word,
        "nested": struct.pack("<iii", 256, 1, 256 | 10) + word,
        "vector": struct.pack("<i", 266) + word + b"\0" * 16,
    }
    tracemalloc.start()
    for data in hostile.values():
        with pytest.raises(WireError):
            decode_bottle(data, V3)
        with pytest.raises(WireError):
            decode_vector(data, V3)
    with pytest.raises(WireError):
        message.read_name(Memory(word + b"x" * 50))
    index = message.number(10) + b"\2\1" + b"\xff" * 8
    with pytest.raises(WireError):
        message.read_message(Memory(index + word * 2 + b"\0\0\0\0" + b"x" * 50))
    with pytest.raises(WireError):
        message.unpack_command(word + b"~\0\0\1" + b"x" * 8)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 20


def test_lists_nest_so_deep_and_no_deeper() -> None:
    deep = struct.pack("<ii", 256, 1) + struct.pack("<ii", 256, 1) * 5000
    with pytest.raises(WireError, match="nested deeper"):
        decode_bottle(deep, V4)
    with pytest.raises(WireError, match="nested deeper"):
        from_text("(" * 5000)


@pytest.mark.parametrize(
    "text", ["(1 2", "1 2)", '"open', "{1 300}", "99999999999999999999", "[setposits]", "{1234567}"]
)
def test_text_that_is_no_bottle(text: str) -> None:
    with pytest.raises(WireError):
        from_text(text)


def holds_floats(items: list[Any]) -> bool:
    return any(
        holds_floats(item) if isinstance(item, list) else isinstance(item, float | Float32) for item in items
    )


def test_mutated_messages_are_read_or_refused_and_nothing_else() -> None:
    """The decoded values account for every received byte. Numbers of one dialect are never read as numbers of
    the other dialect."""
    messages = [(data, DIALECTS[name]) for name in DIALECTS for one in binary(name) for way, data in one
                if way == ">" and len(data) > 30]  # fmt: skip
    chance = random.Random(20261121)
    refused = foreign = 0
    rounds = int(os.environ.get("TCI_FUZZ_WIRE", "20000"))
    tracemalloc.start()
    for _ in range(rounds):
        data, dialect = chance.choice(messages)
        other = V4 if dialect is V3 else V3
        try:
            blocks = message.read_message(Memory(mutated(data, chance)))
            _, body = message.unpack_command(b"".join(blocks))
            items = decode_bottle(body, dialect)
        except WireError:
            refused += 1
            continue
        assert len(encode_bottle(items, dialect)) == len(body)
        with contextlib.suppress(WireError):
            from_text(to_text(items))
        if holds_floats(items):
            foreign += 1
            with pytest.raises(WireError):
                decode_bottle(body, other)
        with contextlib.suppress(WireError):
            assert len(decode_vector(body, dialect)) * 8 + 8 == len(body)
            with pytest.raises(WireError):
                decode_vector(body, other)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()
    assert refused > rounds / 2
    assert foreign > rounds / 100


@pytest.mark.parametrize("array", [np.arange(3.0), np.eye(2), np.arange(3), np.empty(0), np.arange(6.0)[::2]])
def test_an_array_is_encoded_as_the_list_of_its_numbers(array: np.ndarray[Any, Any]) -> None:
    for dialect in (V3, V4):
        assert encode_bottle([array, "x"], dialect) == encode_bottle([array.tolist(), "x"], dialect)
        assert encode_bottle(array, dialect) == encode_bottle(array.tolist(), dialect)
