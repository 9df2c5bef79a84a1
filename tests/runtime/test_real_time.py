"""A loop in real time, where the system permits it, and as it was before afterwards."""

from __future__ import annotations

import os
import struct
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tci.errors import TciError
from tci.runtime import real_time as module
from tci.runtime.real_time import PRIORITY, WAKE_UP, real_time, real_time_where_permitted


def now() -> tuple[int, int, set[int]]:
    """Policy, priority and processors of this thread."""
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)


def permitted() -> bool:
    """Whether this user may ask for real time."""
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


def test_processors_stay_awake_while_the_kernel_is_told_so() -> None:
    before = now()
    if not os.access(WAKE_UP, os.W_OK):
        with (
            pytest.raises(TciError, match="processors can't be kept awake: /dev/cpu_dma_latency: "),
            real_time(awake=True),
        ):
            raise AssertionError
    elif permitted():
        with real_time(awake=True), WAKE_UP.open("rb") as file:
            assert struct.unpack("i", file.read(4)) == (0,)
    assert now() == before


def test_what_keeps_them_awake_is_closed_afterwards(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(module, "WAKE_UP", tmp_path / "latency")
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    with real_time(awake=True):
        assert (tmp_path / "latency").read_bytes() == bytes(4)
        assert str(tmp_path / "latency") in opened()
    assert str(tmp_path / "latency") not in opened()
    monkeypatch.setattr(module, "WAKE_UP", tmp_path / "no folder" / "latency")
    before = now()
    with (
        pytest.raises(TciError, match="latency: No such file or directory; valid: as root, after a udev"),
        real_time(awake=True),
    ):
        raise AssertionError
    assert now() == before


def opened() -> set[str]:
    """Files that this process has open."""
    return {os.path.realpath(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")}


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
