"""Measures of YARP 4's devices with several sensors: bytes of a genuine `multipleanalogsensorsserver` are
decoded and encoded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yarpwire.bottle import decode_bottle, encode_bottle
from yarpwire.dialect import V3, V4
from yarpwire.errors import WireError
from yarpwire.sensors import (
    KINDS,
    SKIN,
    Measure,
    answer_metadata,
    decode_measures,
    encode_measures,
)

CAPTURED = json.loads((Path(__file__).parent / "data" / "sensors.json").read_text())
"""Messages that YARP 4.0.0's `MultipleAnalogSensorsServer` sent for a device with two skin patches of four
values."""
STREAMED, ANSWERED = (bytes.fromhex(CAPTURED[what]) for what in ("measures", "metadata"))


def test_genuine_measures_are_read_and_written_to_the_byte() -> None:
    found = decode_measures(decode_bottle(STREAMED, V4))
    assert [one.values.tolist() for one in found] == [[240, 239, 238, 237], [230, 229, 228, 227]]
    assert all(one.time > 1.7e9 for one in found)
    assert encode_bottle(encode_measures(found), V4) == STREAMED


def test_the_genuine_answer_with_all_names_is_given_to_the_byte() -> None:
    names = ["left_forearm_0", "left_forearm_1"]
    answer = answer_metadata(["getMetadata"], names)
    assert isinstance(answer, list)
    assert encode_bottle(answer, V4) == ANSWERED
    found: Any = decode_bottle(ANSWERED, V4)
    assert [one[0] for one in found[SKIN]] == names
    assert [len(part) for part in found] == [2 if kind == "SkinPatches" else 0 for kind in KINDS]


def test_measures_of_other_sensors_are_no_skin() -> None:
    message = encode_measures([Measure(np.array([0.1, 0.2, 0.3]), 1.5)], kind=0)
    gyro = decode_bottle(encode_bottle(message, V4), V4)
    assert decode_measures(gyro) == ()
    assert decode_measures(gyro, 0)[0].values.tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    "message",
    [
        [],
        [[]] * 11,
        [[]] * 11 + [1.0],
        [*[[]] * 8, [[1.0, 2.0]], *[[]] * 3],
        [*[[]] * 8, [[["a"], 2.0]], *[[]] * 3],
        [*[[]] * 8, [[[1.0], 2.0, 3.0]], *[[]] * 3],
        [*[[]] * 8, [[[1.0], 2.0]] * 1001, *[[]] * 3],
    ],
)
def test_other_messages_are_refused(message: list[Any]) -> None:
    with pytest.raises(WireError):
        decode_measures(message)


def test_the_other_dialect_is_refused() -> None:
    with pytest.raises(WireError):
        decode_bottle(STREAMED, V3)


def test_other_calls_are_answered() -> None:
    assert answer_metadata(["getRemoteProtocolVersion"], ["a"])[:4] == b"\0\1\0\0"
    assert [str(item) for item in answer_metadata(["help"], ["a"])[:1]] == ["[many]"]
    assert [str(item) for item in answer_metadata(["nonsense"], ["a"])] == ["[fail]"]
    assert [str(item) for item in answer_metadata([], ["a"])] == ["[fail]"]
