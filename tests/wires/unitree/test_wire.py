"""Unitree's messages as bytes, compared with a bitwise checksum and with the encoding of cyclonedds."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from cyclonedds.idl._typesupport.DDS.XTypes import TK_UINT8
from hypothesis import given
from hypothesis import strategies as st

from helpers.skin_data import SkinData
from tci.errors import FrameError
from tci.recording.schemas import CLOUD, SKIN
from tci.shared.ros2_dds import _idl
from tci.wires.ros.messages import BYTES
from tci.wires.unitree import messages, wire


def slow_checksum(data: bytes) -> int:
    """Returns the checksum as the vendor computes it: bit by bit, over 32-bit words."""
    crc = 0xFFFFFFFF
    for word in np.frombuffer(data, "<u4").tolist():
        for bit in range(31, -1, -1):
            top = crc >> 31
            crc = (crc << 1) & 0xFFFFFFFF
            if top:
                crc ^= 0x04C11DB7
            if word >> bit & 1:
                crc ^= 0x04C11DB7
    return crc


def test_the_checksum_is_the_vendors() -> None:
    assert wire.checksum(bytes(range(8))) == 0x9C08808D  # computed by the vendor's own library
    rng = np.random.default_rng(1)
    for words in (1, 7, 250):
        data = rng.bytes(4 * words)
        assert wire.checksum(data) == slow_checksum(data)


def made(kind: np.dtype[np.void], seed: int = 0) -> Any:
    """Returns a record in which each field has a different value."""
    record: Any = np.zeros((), kind)
    rng = np.random.default_rng(seed)
    fill(record, rng)
    return record


def fill(record: Any, rng: np.random.Generator) -> None:
    for name in record.dtype.names:
        field = record[name]
        if field.dtype.names:
            for item in field.reshape(-1):
                fill(item, rng)
        else:
            record[name] = rng.integers(0, 100, field.shape)


def values(record: Any) -> Iterator[Any]:
    """Yields all values of a record, in order."""
    for name in record.dtype.names:
        for item in np.atleast_1d(record[name]):
            if record.dtype[name].base.names:
                yield from values(item)
            else:
                yield item.item()


def sample(kind: Any, flat: Iterator[Any]) -> Any:
    """Returns a sample of cyclonedds with these values. The sample has the order of the record, and
    additional nested structures."""
    if dataclasses.is_dataclass(kind):
        return kind(*[sample(field.type, flat) for field in dataclasses.fields(kind)])
    shape = kind.__metadata__[0]
    return (
        next(flat) if isinstance(shape, str) else [sample(shape.subtype, flat) for _ in range(shape.length)]
    )


@pytest.mark.parametrize(
    ("kind", "record", "encode", "decode"),
    [
        (messages.COMMAND, wire.COMMAND, wire.encode_command, wire.decode_command),
        (messages.STATE, wire.STATE, wire.encode_state, wire.decode_state),
    ],
)
def test_messages_are_as_dds_packs_them_and_come_back(
    kind: Any, record: Any, encode: Any, decode: Any
) -> None:
    whole = made(record)
    data = encode(whole)
    back, right = decode(data)
    assert right
    whole["crc"] = back["crc"]
    assert back.tobytes() == whole.tobytes()
    packed = kind.__idl__.serialize(sample(kind, values(whole)), use_version_2=False)
    assert bytes(packed)[4:] == data[4:]


def test_a_changed_byte_makes_the_checksum_wrong() -> None:
    for record, encode, decode in (
        (wire.COMMAND, wire.encode_command, wire.decode_command),
        (wire.STATE, wire.encode_state, wire.decode_state),
    ):
        data = bytearray(encode(made(record)))
        for place in (4, 5, 6, 200, len(data) - 1):
            data[place] ^= 1
            assert not decode(bytes(data))[1]
            data[place] ^= 1
        assert decode(bytes(data))[1]


def kinds(node: Any) -> Iterator[int]:
    """Yields the kinds of all types in a type description."""
    if isinstance(node, list | tuple):
        for item in node:
            yield from kinds(item)
    elif hasattr(node, "discriminator"):
        yield node.discriminator
        yield from kinds(node.value)
    elif dataclasses.is_dataclass(node):
        for field in dataclasses.fields(node):
            yield from kinds(getattr(node, field.name))


@pytest.mark.parametrize(
    "kind", [messages.COMMAND, messages.STATE, messages.HAND_STATE, *map(_idl, (BYTES, CLOUD, SKIN))]
)
def test_cyclone_of_robots_and_of_ros_knows_every_type(kind: Any) -> None:
    """With the type TK_UINT8, a program with cyclonedds 0.10.2 that read TCI's bytes ended with a
    segmentation fault."""
    assert TK_UINT8 not in kinds(kind.__idl__.get_type_mapping())


def test_a_hand_says_how_many_motors_and_pads_it_has() -> None:
    motors, pads = np.zeros(7, wire.MOTOR_STATE), np.zeros(9, wire.PRESS)
    motors["q"], pads["pressure"] = np.arange(7), np.arange(108).reshape(9, 12)
    data = wire.encode_hand(motors, pads)
    hand = wire.decode_hand(data)
    assert hand.motors["q"].tolist() == list(range(7))
    assert hand.pads["pressure"].ravel().tolist() == list(range(108))
    assert len(wire.decode_hand(wire.encode_hand(motors, pads[:7])).pads) == 7
    size = len(data)
    assert size == 1428  # the size of messages of the vendor's Python SDK


@given(st.binary(max_size=2100), st.sampled_from([996, 1000, 2088, 2092]))
def test_damaged_messages_are_refused_or_judged(data: bytes, size: int) -> None:
    for form in (data, wire.HEAD + data, (wire.HEAD + data).ljust(size, b"\7")[:size]):
        for decode in (wire.decode_command, wire.decode_state, wire.decode_hand):
            try:
                decode(form)
            except FrameError:
                continue


def test_what_the_vendors_programs_sent_is_read(genuine_data: SkinData) -> None:
    """The vendor's Python simulation sends no checksum. All other programs of the vendor send a checksum."""
    folder = genuine_data.file("unitree")
    for name, right, variant in (
        ("lowstate_from_sdk2cpp", True, 5),
        ("lowstate_from_sdk2py", True, 5),
        ("lowstate_from_vendor_mujoco", False, 0),
    ):
        data = (folder / f"{name}.cdr").read_bytes()
        state, good = wire.decode_state(data)
        assert (good, state["mode_machine"]) == (right, variant)
        if good:
            assert wire.encode_state(np.array(state)) == data
    data = (folder / "lowcmd_from_sdk2cpp.cdr").read_bytes()
    command, good = wire.decode_command(data)
    assert good
    assert wire.encode_command(np.array(command)) == data
    assert command["motor"]["q"][:29] == pytest.approx(0.01 * np.arange(29))
    assert command["motor"]["kp"][:29].tolist() == (40.0 + np.arange(29)).tolist()
    hand = wire.decode_hand((folder / "handstate_from_sdk2py.cdr").read_bytes())
    assert hand.motors["q"] == pytest.approx(0.1 * np.arange(7))
    assert hand.pads["pressure"][8].tolist() == (80.0 + np.arange(12)).tolist()
