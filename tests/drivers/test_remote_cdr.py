"""Messages between TCI processes as bytes: valid messages are decoded without changes, and damaged messages
are refused."""

from __future__ import annotations

import dataclasses
import os
import random
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.remote_messages import COUNT, FRAME, NAO, ORDERS, READ, STATE, WHOLE, plain
from tci.drivers.remote.commanders import Commanders
from tci.drivers.remote.encoding import (
    ENVELOPE,
    orders_bytes,
    seal,
    state_bytes,
    to_orders,
    to_state,
)
from tci.drivers.remote.protocol import MOST_COMMANDERS, MOST_WORDS, Commander
from tci.errors import FrameError
from tci.gate.gate import Gate
from tci.messages import JointReading, Mode, PlatformSwitch
from tci.reasons import Code, Reason
from tci.robot.joint_map import initial_position


@pytest.mark.parametrize(("kind", "before"), [("S", STATE), ("F", FRAME), ("O", ORDERS)])
def test_what_arrives_is_what_was_sent(kind: str, before: object) -> None:
    assert plain(READ[kind](NAO, WHOLE[kind])) == plain(before)


def test_a_robot_that_says_little_is_read_back_too() -> None:
    bare = dataclasses.replace(
        STATE, joints=JointReading(1.0, 2, np.zeros(COUNT), np.zeros(COUNT)), commanders=()
    )
    assert plain(to_state(NAO, state_bytes(NAO, bare))) == plain(bare)


def test_16_messages_for_another_robot_are_refused_by_the_hash_of_its_description() -> None:
    other = NAO.model_copy(update={"digest": "0123456789abcdef" * 4})
    for kind, data in WHOLE.items():
        with pytest.raises(FrameError, match="0123456789abcdef"):
            READ[kind](other, data)


def test_35_another_kind_of_message_is_refused() -> None:
    for kind, data in WHOLE.items():
        with pytest.raises(FrameError, match="kind"):
            READ[{"S": "F", "F": "O", "O": "S"}[kind]](NAO, data)


def test_37_no_bit_can_flip_unseen() -> None:
    for kind, data in WHOLE.items():
        for bit in range(8 * len(data)):
            damaged = bytearray(data)
            damaged[bit // 8] ^= 1 << bit % 8
            with pytest.raises(FrameError):
                READ[kind](NAO, bytes(damaged))


def test_30_a_message_that_was_cut_short_is_refused() -> None:
    for kind, data in WHOLE.items():
        for end in range(len(data)):
            with pytest.raises(FrameError):
                READ[kind](NAO, data[:end])


def test_31_spoilt_contents_under_a_sound_check_raise_one_error() -> None:
    """Messages with a valid checksum and invalid content: lengths of -1 and 2^31-1, invalid text.
    TCI_FUZZ_WIRE sets their number."""
    chance = random.Random(1)
    for _ in range(int(os.environ.get("TCI_FUZZ_WIRE", "20000"))):
        kind = chance.choice("SFO")
        body = bytearray(WHOLE[kind][ENVELOPE.size :])
        for _ in range(chance.randint(1, 4)):
            place = chance.randrange(len(body))
            value = chance.choice([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", chance.randbytes(1)])
            body[place : place + len(value)] = value
        try:
            READ[kind](NAO, seal(NAO, kind.encode(), bytes(body)))
        except FrameError:
            continue


def test_a_message_of_another_version_is_told_from_a_damaged_one() -> None:
    for version in b"3", b"5":
        data = WHOLE["S"].replace(b"TCI4", b"TCI" + version, 1)
        with pytest.raises(FrameError, match="the TCI there has another version; valid: the same on both"):
            to_state(NAO, data)


def test_a_code_of_a_later_version_is_other_and_keeps_its_text() -> None:
    state = dataclasses.replace(STATE, reason=Reason(Code.JOINTS_STALE, "why"), met=())
    sent = state_bytes(NAO, state).split(b"hold", 1)
    code, later = struct.pack("<H", Code.JOINTS_STALE), struct.pack("<H", 60_000)
    assert sent[1].count(code) == 1
    body = (sent[0] + b"hold" + sent[1].replace(code, later))[ENVELOPE.size :]
    assert to_state(NAO, seal(NAO, b"S", body)).reason == Reason(Code.OTHER, "why")


def test_31_words_of_others_can_be_printed_and_are_bounded() -> None:
    wild = "\udcff\x1b[2J\n" * 2000
    orders = dataclasses.replace(ORDERS, name=wild, halt=Reason.of(wild))
    state = dataclasses.replace(
        STATE, reason=Reason.of(wild), commanders=(Commander(5, wild, 6, 2, Reason.of(wild)),)
    )
    heard, told = to_orders(NAO, orders_bytes(NAO, orders)), to_state(NAO, state_bytes(NAO, state))
    (member,) = told.commanders
    for words in (heard.name, str(heard.halt), str(told.reason), member.name, str(member.reason)):
        assert words.isprintable()
        assert len(words.encode()) <= 4 * MOST_WORDS


def test_33_what_many_commanders_are_refused_fits_in_a_state() -> None:
    now = 1.0
    everybody = Commanders(NAO, 7, 1.0, lambda: now)
    for client in range(1, MOST_COMMANDERS + 1):
        order = PlatformSwitch(np.full(10_000, 99_999), Mode.POSITION)
        everybody.receive(
            dataclasses.replace(ORDERS, session=7, seen=now, client=client, first=1, orders=(order,))
        )
    gate = Gate(NAO, period=0.01, stale_after=1.0)
    joints = JointReading(now, 1, np.array(initial_position(NAO)), np.zeros(COUNT))
    everybody.decided(gate.step(everybody.take(), joints, now))
    state = dataclasses.replace(STATE, commanders=everybody.states())
    told = to_state(NAO, state_bytes(NAO, state))
    assert len(told.commanders) == MOST_COMMANDERS
    assert all("99999" in str(member.reason) for member in told.commanders)


@given(st.sampled_from("SFO"), st.binary(max_size=400))
def test_any_bytes_raise_one_error(kind: str, data: bytes) -> None:
    with pytest.raises(FrameError):
        READ[kind](NAO, data)
