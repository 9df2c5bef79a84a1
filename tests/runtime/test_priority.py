"""A loop runs in real time if the system permits this. Afterwards the previous settings are restored."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

import pytest

from tci.errors import TciError
from tci.runtime.priority import PRIORITY, real_time, real_time_where_permitted


def now() -> tuple[int, int, set[int]]:
    """Returns scheduling policy, priority and processors of this thread."""
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)


def permitted() -> bool:
    """Returns True if this user may use real-time priority."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def test_inside_it_is_real_time_and_afterwards_as_before() -> None:
    before = now()
    processor = max(before[2])
    if not permitted():
        with pytest.raises(TciError, match=r"limits\.conf"), real_time(processor=processor):
            raise AssertionError
    else:
        with suppress(ZeroDivisionError), real_time(processor=processor):
            assert now() == (os.SCHED_FIFO, PRIORITY, {processor})
            raise ZeroDivisionError
    assert now() == before


def test_the_processors_stay_where_none_is_named() -> None:
    before = now()
    with suppress(TciError), real_time():
        assert now() == (os.SCHED_FIFO, PRIORITY, before[2])
    assert now() == before


def test_elsewhere_it_tells_where_there_is_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(TciError, match="real time on darwin; valid: on Linux"), real_time():
        raise AssertionError


def test_where_it_is_not_permitted_it_tells_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    before = now()
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with (
        pytest.raises(TciError, match="permits no real time with priority 50; valid: as root, or after"),
        real_time(),
    ):
        raise AssertionError
    assert now() == before


def test_where_it_is_not_permitted_one_may_go_on_without() -> None:
    before, may = now(), permitted()
    with real_time_where_permitted():
        assert now() == ((os.SCHED_FIFO, PRIORITY, before[2]) if may else before)
    assert now() == before


def test_what_fails_inside_is_told_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with pytest.raises(TciError, match="the robot is gone"), real_time_where_permitted():
        raise TciError("the robot is gone")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"priority": 0}, "priority 0; valid: 1 to 99"),
        ({"priority": 100}, "priority 100; valid: 1 to 99"),
        ({"processor": 4096}, "processor 4096; valid here: "),
    ],
)
def test_what_makes_no_sense_is_refused(words: dict[str, int], message: str) -> None:
    before = now()
    with pytest.raises(TciError, match=message), real_time(**words):
        raise AssertionError
    assert now() == before
