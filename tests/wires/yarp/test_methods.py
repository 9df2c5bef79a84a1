"""Every method of the remote control board interfaces returns its complete answer, even if the robot lacks
the feature."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.board_methods import PAGE, board, calls_v3, calls_v4, is_answered, page
from yarpwire.bottle import decode_bottle, encode_bottle
from yarpwire.calls_v3 import answer_v3
from yarpwire.calls_v4 import answer_v4
from yarpwire.dialect import V3, V4
from yarpwire.returns_v4 import RETURNS
from yarpwire.values import Vocab

FAILURES = [Vocab("err2")], [Vocab("err5")]


def fits(value: Any, kind: str) -> bool:
    """Returns True if a field can be read as its type. A list of numbers contains the type of its items
    once."""
    lists = {"f64s": float, "i32s": int, "map": list, "lists": list, "bottle": object}
    if kind in lists:
        return isinstance(value, list) and all(isinstance(item, lists[kind]) for item in value)
    if kind in ("pid", "info"):
        count, item = (10, float) if kind == "pid" else (13, str)
        return isinstance(value, list) and [type(one) for one in value] == [item] * count
    if kind == "bool":
        return value in (Vocab("ok"), Vocab("fail")) and isinstance(value, Vocab)
    return type(value) is {"f64": float, "i32": int, "str": str}[kind]


@pytest.mark.parametrize("joint", [3, 99])
def test_every_method_of_4_0_returns_all_its_fields(joint: int) -> None:
    """A genuine client reads every field, also in the answer to a refused call, and waits for a missing
    field."""
    shown, wrong, silent = board(), [], []
    for _, method, call, fields in calls_v4(joint):
        for items in (call, call[:1], [*call, 1]):
            said = answer_v4(shown, items)
            assert not isinstance(said, bytes)
            found = decode_bottle(encode_bottle(said, V4), V4)
            result, *values = found if fields else [found]
            if len(values) != len(fields) or not all(map(fits, values, fields)):
                wrong.append(f"{method}: {found}; valid: {fields}")
            if result != [Vocab("ok")] and result not in FAILURES:
                silent.append(f"{method}: {found}")
    assert wrong == []
    assert silent == []


def test_the_methods_of_4_0_are_those_of_its_interface() -> None:
    assert sorted(RETURNS) == sorted(call[0] for _, _, call, _ in calls_v4())
    assert answer_v4(board(), ["nonsenseRPC"]) == [Vocab("fail")]


def test_every_call_of_3_12_is_answered_or_refused_in_words() -> None:
    shown = board()
    for _, method, call in calls_v3():
        found = decode_bottle(encode_bottle(answer_v3(shown, call), V3), V3)
        if is_answered(found, V3) and call[0] == Vocab("get"):
            assert Vocab("tsta") in found, method
        else:
            assert found in ([Vocab("ok")], [Vocab("fail")]), method


def test_getters_return_what_the_board_knows() -> None:
    shown = board()
    for call, answer in (
        (["getTargetVelocityAllRPC"], [0.0] * 16), (["getRefTorqueGroupRPC", [0, 3]], [0.0, 0.0]),
        (["getTrajSpeedsGroupRPC", [0, 3]], [10.0, 10.0]), (["getTrajSpeedOneRPC", 3], 10.0),
        (["getAxisNameRPC", 3], "l_elbow"), (["isCalibratorDevicePresentRPC"], Vocab("fail")),
        (["isJointBrakedRPC", 3], Vocab("fail")), (["getAutoBrakeEnabledRPC", 3], Vocab("fail")),
    ):  # fmt: skip
        assert answer_v4(shown, call) == [[Vocab("ok")], answer]
    low, high = answer_v4(shown, ["getTorqueRangeAllRPC"])[1:]
    assert low == [-torque for torque in high]


def test_the_page_shows_what_the_board_answers() -> None:
    assert PAGE.read_text() == page(), "valid: the page that python tests/helpers/board_methods.py writes"
