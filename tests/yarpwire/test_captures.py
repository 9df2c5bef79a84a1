"""Recorded messages of genuine YARP are decoded and encoded again, and are equal byte by byte."""

from __future__ import annotations

import pytest

from helpers.yarp_captures import DIALECTS, NAMES, Connection, binary, flows, said, textual
from yarpwire import message
from yarpwire.bottle import (
    decode_bottle,
    decode_vector,
    dialect_of_vector,
    encode_bottle,
    encode_vector,
    read_bottle,
)
from yarpwire.dialect import V4, Dialect
from yarpwire.source import Memory
from yarpwire.text import from_text, to_text

FAST_TCP = 3


def again(blocks: list[bytes], dialect: Dialect) -> bytes:
    """Decodes a message, and returns the message that is encoded from the decoded values."""
    command, body = message.unpack_command(b"".join(blocks))
    head = message.pack_command(command.kind, str(command.stamp or ""))
    if not body:
        return message.pack_message([head])
    if len(blocks) == 3 or (len(blocks) == 2 and dialect_of_vector(body) and len(blocks[1]) == 8):
        return message.pack_message([head, *encode_vector(decode_vector(body, dialect), dialect)])
    return message.pack_message([head, encode_bottle(decode_bottle(body, dialect), dialect)])


def check(connection: Connection, dialect: Dialect) -> int:
    there, back = Memory(said(connection, ">")), Memory(said(connection, "<"))
    code = message.read_number(there) - message.MAGIC
    out = message.header(code, message.read_name(there))
    answer = message.number(message.read_number(back))
    count = 0
    while there.left():
        blocks = message.read_message(there)
        out += again(blocks, dialect)
        if message.unpack_command(b"".join(blocks))[0].kind == message.CALL:
            answer += encode_bottle(read_bottle(back, dialect), dialect)
        if code != FAST_TCP:
            answer += message.number(message.read_number(back))
        count += 1
    assert out == said(connection, ">")
    assert answer == said(connection, "<")
    return count


@pytest.mark.parametrize("name", NAMES)
def test_binary_connections_are_encoded_to_the_same_bytes(name: str) -> None:
    counts = [check(connection, DIALECTS[name]) for connection in binary(name)]
    expected = {"v4rpc": 4, "v4tcp": 3, "v4fast_tcp": 3, "st3": 6, "st4": 6, "nwc3": 6}
    assert sum(counts) == expected.get(name, 0)


@pytest.mark.parametrize("name", NAMES)
def test_bottles_in_text_are_written_the_same(name: str) -> None:
    lines = [
        line
        for connection in textual(name)
        for _, data in connection
        for line in data.decode().split("\r\n")
        if line[:1] in ("[", "(", "0", "1")
    ]
    assert [to_text(from_text(line)) for line in lines] == lines
    assert len(lines) >= len(textual(name)) // 2


def test_the_mixed_bottle_of_yarp_write_means_what_was_typed() -> None:
    for name in ("v4tcp", "v4fast_tcp"):
        there = Memory(said(binary(name)[0], ">"))
        message.read_number(there)
        message.read_name(there)
        _, body = message.unpack_command(b"".join(message.read_message(there)))
        typed = "1 2.5 hello (3 4) (a 1 2.0) [set] {1 2 3} 12345678901"
        assert to_text(decode_bottle(body, V4)) == typed
        assert encode_bottle(from_text(typed), V4) == body


def test_state_of_a_real_board_carries_its_stamp() -> None:
    for name, values in (("st3", [5.0, 7.5, 3.0, 4.0]), ("st4", [0.0] * 4)):
        there = Memory(said(binary(name)[0], ">"))
        message.read_number(there)
        assert message.read_name(there) == "/fake/arm/state:o"
        counts = []
        while there.left():
            command, body = message.unpack_command(b"".join(message.read_message(there)))
            assert command.stamp is not None
            assert 1795218720 < command.stamp.time < 1795218740
            counts.append(command.stamp.count)
            assert decode_vector(body, DIALECTS[name]).tolist() == values
        assert counts == list(range(counts[0], counts[0] + 6))


def test_every_capture_is_used() -> None:
    assert set(flows()) == set(NAMES)
