"""Heartbeats: a silent process is detected in time, and arbitrary bytes are ignored."""

from __future__ import annotations

import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.errors import DriverError, TciError
from tci.reasons import Code, Reason
from tci.runtime.heartbeat import TIMEOUT, Listener, Sender, decode, encode


def test_28_silence_is_told_after_the_timeout_and_clears() -> None:
    now = 0.0
    with Listener(["brain"], clock=lambda: now) as listener:
        assert "brain" in str(listener.fault())
        sender = Sender("brain", listener.port)
        sender.beat()
        assert listener.fault() is None
        now = TIMEOUT
        assert listener.fault() is None
        now = TIMEOUT + 0.001
        assert listener.fault() == Reason(Code.HEARTBEAT_MISSING, "no heartbeat of brain")
        sender.beat()
        assert listener.fault() is None
        sender.close()


def test_36_a_port_that_is_taken_is_a_clear_error() -> None:
    with Listener([]) as first, pytest.raises(DriverError, match=f"{first.port}.*valid"):
        Listener([], port=first.port)


def test_33_a_flood_is_looked_at_in_bounded_parts() -> None:
    with Listener(["brain"]) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
        for _ in range(200):
            flood.sendto(b"x" * 60, ("127.0.0.1", listener.port))
        listener.fault()
        assert listener.rejected == 64


def test_34_an_old_beat_is_no_sign_of_life() -> None:
    with Listener(["brain"]) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as replay:
        for sequence in (5, 5, 4):
            replay.sendto(encode("brain", sequence), ("127.0.0.1", listener.port))
        listener.fault()
        assert listener.rejected == 2


@given(st.binary(max_size=64))
def test_30_35_any_bytes_are_no_beat(data: bytes) -> None:
    assert decode(data) is None


@given(st.integers(0, 2**64 - 1), st.integers(0, 255))
def test_37_each_flipped_bit_is_found(sequence: int, bit: int) -> None:
    good = encode("brain", sequence)
    bad = bytearray(good)
    bad[bit // 8] ^= 1 << bit % 8
    assert decode(good) == ("brain", sequence)
    assert decode(bytes(bad)) is None


@pytest.mark.parametrize("name", ["", "x" * 17, "a\0b"])
def test_names_are_checked(name: str) -> None:
    with pytest.raises(TciError, match="1 to 16"):
        encode(name, 0)
