"""Watchdogs of the loop, each tested separately: silent skin, stalls, signals, threads, the folder of the
lease."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tci
from tci.drivers.lease import lease
from tci.drivers.wrapper import DriverWrapper
from tci.errors import DriverError
from tci.gate.gate import GateState
from tci.messages import JointReading, ManualClock, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.reasons import Code, Reason
from tci.runtime.watchdogs import (
    LEAST_SILENCE,
    MOVED,
    PILED_UP,
    STOOD,
    TURN,
    SkinWatchdog,
    StallDetector,
    attentive,
    implausible_force,
    interruptions,
)
from tci.testing import TouchedRobot

NAO = tci.load_robot("nao")
PATCHES = [patch.name for patch in NAO.patches]


def reading(**sequences: int) -> Reading:
    """Returns a reading with joints, and with a frame of each named patch that has its sequence number."""
    zeros = np.zeros(len(NAO.servos))
    frames = (SkinFrame(name, 0.0, number, np.zeros(4)) for name, number in sequences.items())
    return Reading(JointReading(0.0, 0, zeros, zeros), tuple(frames))


def test_a_patch_that_falls_silent_is_named_and_those_that_never_spoke_are_not() -> None:
    silence = SkinWatchdog(NAO, stale_after=0.05)
    one, two = PATCHES[:2]
    for k in range(10):
        assert not silence.fault(reading(**{one: k, two: k}), 0.02 * k)
    last = 0.02 * 9
    assert not silence.fault(reading(**{one: 10, two: 9}), last + LEAST_SILENCE - 1e-6)
    reason = silence.fault(reading(**{one: 11, two: 9}), last + LEAST_SILENCE + 0.01)
    assert reason is not None
    assert reason.code is Code.SKIN_SILENT
    said = reason.text
    assert two in said
    assert one not in said
    assert "260 ms" in said
    assert not silence.fault(reading(**{one: 12, two: 10}), last + LEAST_SILENCE + 0.02), "it is back"
    assert two in str(silence.fault(reading(**{one: 13}), last + 3 * LEAST_SILENCE)), (
        "not even in the reading"
    )


@pytest.mark.parametrize(
    ("stale_after", "keep_alive", "longest"),
    [(0.05, None, LEAST_SILENCE), (0.6, None, 0.6), (0.05, 0.5, 1.5), (0.05, 0.01, LEAST_SILENCE)],
)
def test_silence_is_as_long_as_driver_and_senders_allow(
    stale_after: float, keep_alive: float | None, longest: float
) -> None:
    silence = SkinWatchdog(NAO, stale_after=stale_after, keep_alive=keep_alive)
    here = reading(**{PATCHES[0]: 1})
    assert not silence.fault(here, 5.0)
    assert not silence.fault(here, 5.0 + longest)
    assert silence.fault(here, 5.0 + longest + 1e-6)
    assert "for 9000 ms" in str(silence.fault(here, 14.0))


def test_a_patch_that_the_robot_lacks_is_nobodys_silence() -> None:
    silence = SkinWatchdog(NAO, stale_after=0.05)
    assert not silence.fault(reading(), 1e6)
    assert not silence.fault(reading(tail=1), 0.0)
    assert not silence.fault(reading(tail=1), 1e6)


def test_torques_that_vanish_are_told_with_code_time_and_what_they_felt() -> None:
    robot = tci.load_robot("g1-bare")
    silence, zeros = SkinWatchdog(robot, stale_after=0.05), np.zeros(len(robot.servos))
    felt = Reading(JointReading(0.0, 0, zeros, zeros, zeros), ())
    assert not silence.fault(felt, 0.0)
    assert not silence.fault(felt, LEAST_SILENCE)
    reason = silence.fault(felt, 5.0)
    assert reason is not None
    assert reason.code is Code.SKIN_SILENT
    assert reason.text.startswith("the joints of left_arm have reported no new torques for 5000 ms: left_")
    names = [patch.name for patch in robot.patches if patch.part == "left_arm"]
    assert reason.text.endswith(f": {', '.join(names)} feel nothing")


def test_a_part_that_never_reports_the_torques_that_it_feels_with_is_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot = tci.load_robot("g1-bare")
    silence, torque = SkinWatchdog(robot, stale_after=0.05), np.full(len(robot.servos), np.nan)
    torque[[one.servo for one in robot.part("left_arm").servos if one.servo is not None]] = 0.0
    for k in range(100):
        joints = JointReading(0.02 * k, k, 0.0 * torque, 0.0 * torque, torque + 0.01 * k)
        assert not silence.fault(Reading(joints, ()), 0.02 * k)
    names = ", ".join(patch.name for patch in robot.patches if patch.part == "right_arm")
    said = f"the joints of right_arm report no torques: {names} feel nothing (tci doctor)"
    assert [one.message for one in caplog.records] == [said]


@pytest.mark.parametrize("how", ["none", "nan", "frozen"])
def test_torques_that_vanish_silence_what_is_felt_through_joints(how: str) -> None:
    robot = tci.load_robot("g1-bare")
    silence, count = SkinWatchdog(robot, stale_after=0.05), len(robot.servos)

    def told(now: float, *, torque: Array | None, moving: bool = True) -> str:
        position = np.full(count, now if moving else 0.0)
        joints = JointReading(now, 0, position, np.zeros(count), torque)
        return str(silence.fault(Reading(joints, ()), now) or "")

    assert not told(-1.0, torque=None), "a robot that never reported torques feels nothing, and may move"
    for k in range(10):
        assert not told(0.8 + 0.02 * k, torque=np.full(count, 0.1 * k))
    still = np.full(count, 1.3)
    for k in range(100):
        assert not told(1.0 + 0.02 * k, torque=still, moving=False), "at rest they may stay"
    last, gone = 1.0 + 0.02 * 99, {"none": None, "nan": np.full(count, np.nan), "frozen": still}[how]
    assert not told(last + LEAST_SILENCE, torque=gone)
    said = told(last + LEAST_SILENCE + 0.02, torque=gone)
    assert "joints of left_arm have reported no new torques for 2" in said
    assert "left_forearm" in said
    assert "feel nothing" in said
    assert not told(last + LEAST_SILENCE + 0.03, torque=np.ones(count)), "they are back"


def test_torques_that_stay_equal_while_a_simulated_arm_creeps_to_rest_are_not_frozen() -> None:
    robot = tci.load_robot("g1-bare")
    silence, count = SkinWatchdog(robot, stale_after=0.05), len(robot.servos)
    for k in range(1000):
        joints = JointReading(0.02 * k, 0, np.full(count, 1e-18 * k), np.zeros(count), np.full(count, 1.3))
        assert not silence.fault(Reading(joints, ()), 0.02 * k)


@pytest.mark.parametrize("absent", [False, True])
@pytest.mark.parametrize(("degrees_per_s", "rate"), [(0.5, 100), (1.0, 500), (5.0, 1000)])
def test_torques_that_freeze_while_an_arm_moves_slowly_are_told(
    degrees_per_s: float, rate: int, absent: bool
) -> None:
    robot = tci.load_robot("g1-bare")
    silence, count = SkinWatchdog(robot, stale_after=0.05), len(robot.servos)
    torque = np.full(count, 1.3)
    if absent:  # one joint of the part reports no torque
        torque[robot.part("left_arm").servos[0].servo] = np.nan
    for k in range(2 * rate):
        now = k / rate
        position = np.full(count, np.deg2rad(degrees_per_s) * now)
        joints = JointReading(now, 0, position, np.zeros(count), torque)
        if silence.fault(Reading(joints, ()), now):
            break
    assert now == pytest.approx(MOVED / np.deg2rad(degrees_per_s) + LEAST_SILENCE, abs=0.03)


@pytest.mark.parametrize(("stale_after", "longest"), [(0.05, STOOD), (0.5, 0.5)])
def test_a_standstill_is_longer_than_a_busy_machine_and_than_what_the_driver_allows(
    stale_after: float, longest: float
) -> None:
    clock = ManualClock(3.0)
    still = StallDetector(clock, stale_after=stale_after)
    for _ in range(3):
        clock.advance(longest - 1e-6)
        assert still.fault() is None
    clock.advance(longest + 0.001)
    words = f"this process stood still for {longest * 1e3 + 1:.0f} ms"
    assert still.fault() == Reason(Code.PROCESS_FROZEN, words)
    clock.advance(PILED_UP - 0.001)
    assert still.fault()
    clock.advance(0.002)
    assert still.fault() is None


def test_a_standstill_of_exactly_what_is_allowed_is_none_and_ends_exactly() -> None:
    clock = ManualClock(0.0)
    still = StallDetector(clock, stale_after=0.5)
    clock.advance(0.5)
    assert still.fault() is None
    clock.advance(1.0)
    assert still.fault()
    clock.advance(1.5 + PILED_UP - clock.now())
    assert still.fault() is None


def test_42_a_second_signal_interrupts_what_hangs_and_handlers_are_as_before() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    seen: list[int | None] = []

    def hang() -> None:
        with interruptions() as found:
            os.kill(os.getpid(), signal.SIGTERM)
            seen.append(found.signal)
            os.kill(os.getpid(), signal.SIGTERM)
            seen.append(None)

    with pytest.raises(KeyboardInterrupt):
        hang()
    assert seen == [signal.SIGTERM], "the second one did not interrupt"
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_the_first_thread_that_fails_is_the_one_that_is_told_and_one_that_exits_is_no_failure() -> None:
    def in_thread(name: str, error: type[BaseException]) -> None:
        def work() -> None:
            raise error(name)

        thread = threading.Thread(target=work, name=name)
        thread.start()
        thread.join()

    hook = threading.excepthook
    with interruptions() as found:
        in_thread("leaving", SystemExit)
        assert found.failure is None
        found.raise_it()
        in_thread("first", ZeroDivisionError)
        in_thread("second", ValueError)
        assert found.thread == "first"
        with pytest.raises(ZeroDivisionError, match="first"):
            found.raise_it()
    assert threading.excepthook is hook


def test_42_outside_the_main_thread_signals_are_left_alone() -> None:
    handlers: list[object] = []

    def work() -> None:
        with interruptions():
            handlers.append(signal.getsignal(signal.SIGTERM))

    before = signal.getsignal(signal.SIGTERM)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handlers == [before]


def test_26_a_folder_that_others_may_write_to_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(words: str) -> None:
        with pytest.raises(DriverError, match=f"{words}; valid: .*TCI_LEASES"), lease("mine"):
            pytest.fail("the lease was given")

    folder, link, file = tmp_path / "leases", tmp_path / "link", tmp_path / "file"
    monkeypatch.setenv("TCI_LEASES", str(folder))
    with lease("mine"):
        assert [one.suffix for one in folder.iterdir()] == [".lease"]
    folder.chmod(0o770)
    refused("others may write to")
    folder.chmod(0o700)
    link.symlink_to(folder)
    monkeypatch.setenv("TCI_LEASES", str(link))
    refused("is no folder")
    file.touch()
    monkeypatch.setenv("TCI_LEASES", str(file))
    refused("File exists")
    monkeypatch.setenv("TCI_LEASES", str(folder))
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000)
    refused("belongs to another user")


@pytest.mark.parametrize("usual", [0.02, 0.8 * TURN])
def test_threads_get_their_turn_and_it_is_as_before_afterwards(usual: float) -> None:
    before = sys.getswitchinterval()
    sys.setswitchinterval(usual)
    try:
        with suppress(ZeroDivisionError), attentive():
            assert sys.getswitchinterval() == pytest.approx(min(usual, TURN), abs=5e-6)
            raise ZeroDivisionError
        assert sys.getswitchinterval() == pytest.approx(usual, abs=5e-6)
    finally:
        sys.setswitchinterval(before)


def test_26_no_lease_is_cleared_away_while_it_is_held(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The program systemd-tmpfiles removes old files, except in a folder that another process has locked."""
    monkeypatch.setenv("TCI_LEASES", str(tmp_path))
    tmp_path.chmod(0o700)
    handle = os.open(tmp_path, os.O_RDONLY)
    try:
        with lease("mine"), lease("yours"), pytest.raises(BlockingIOError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(handle)


class Heavy(DriverWrapper):
    """A robot whose left arm needs more torque than its description says, as with a tool in the hand."""

    def _receive(self) -> Reading:
        reading = self.inner.read()
        assert reading.joints.torque is not None
        torque = reading.joints.torque.copy()
        torque[self.robot.part("left_arm").servos[0].servo] += 60.0
        return replace(reading, joints=replace(reading.joints, torque=read_only(torque)))


def test_torques_that_no_push_explains_hold_the_robot() -> None:
    with tci.connect("g1-bare", "sim") as driver:
        result = tci.run(Heavy(driver), tci.WithdrawalReflex(), duration=1.0)
    assert result.state is GateState.HOLD
    assert any("the joint torques of left_arm mean a push of" in str(notice) for notice in result.holds)
    assert not result.moved


def test_only_touches_that_are_estimated_from_torques_are_judged_by_their_force() -> None:
    contacts = TouchedRobot("nao").perceive("left_forearm", force=5.0).contacts
    strong = contacts.changed(force=[400.0])
    assert implausible_force(strong) is None
    assert implausible_force(strong.changed(certainty=[0.7])) is not None
    assert implausible_force(strong.changed(certainty=[0.7], force=[90.0])) is None
