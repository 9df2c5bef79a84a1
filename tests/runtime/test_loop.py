"""Faults of the loop: the loop counts faults, holds or stops the robot, and never ends while the robot
moves."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tci
from tci.body import BodySettings
from tci.body.generic_body import GenericBody
from tci.drivers.lease import lease
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DriverError, TciError
from tci.gate.gate import GateState, SafeCommand
from tci.messages import (
    GenericCommand,
    ManualClock,
    Mode,
    Order,
    Perception,
    Reading,
    SkinFrame,
    SwitchMode,
)
from tci.reasons import Code, Reason
from tci.runtime.control import PERSISTS, REST, Control
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import FINEST, Histogram, LoopReport
from tci.runtime.moment import Moment
from tci.runtime.watchdogs import (
    LEAST_SILENCE,
    MISSED,
    frozen_garbage,
    interruptions,
    missed_periods,
    usual_watchdogs,
)
from tci.simulation.world import World
from tci.skin import ConditioningSettings
from tci.testing import FakeDriver


class Swing(tci.Capability[int]):
    """Commands the head to a distant target immediately, and may run an action in step number `at`."""

    def __init__(self, at: int = -1, what: Callable[[], object] = int) -> None:
        self.at, self.what = at, what

    def init(self, body: GenericBody) -> int:
        return 0

    def step(
        self, memory: int, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], int]:
        if memory == self.at:
            self.what()
        target = perception.posture["head"].copy()
        target[0] += 0.4
        commands = () if memory else (GenericCommand("head", Mode.POSITION, target),)
        return commands, memory + 1


class Still(Swing):
    """Sends no commands."""

    def step(
        self, memory: int, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], int]:
        return (), memory + 1


def fail() -> None:
    raise ZeroDivisionError("on purpose")


def speed(driver: SimulatedDriver) -> float:
    return float(np.abs(driver.read().joints.velocity).max())


def test_45_an_exception_of_the_capability_stops_the_robot_and_is_raised(driver: SimulatedDriver) -> None:
    report = LoopReport()
    fast: list[float] = []
    with pytest.raises(ZeroDivisionError):
        run(
            driver,
            Swing(40, fail),
            duration=1.0,
            report=report,
            observe=lambda tick: fast.append(speed(driver)),
        )
    assert fast[-1] > 0.3
    assert driver.gate.state is GateState.STOP
    assert report.ended == "ZeroDivisionError: on purpose"
    driver.world.advance(driver.world.time + 0.05)
    assert speed(driver) < 0.02


def test_45_while_it_comes_to_rest_the_robot_is_told_why_and_no_longer_than_that(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, after = driver.write, []
    failed: list[bool] = []

    def watched(safe: SafeCommand) -> SafeCommand:
        if failed:
            after.append(safe)
        return write(safe)

    monkeypatch.setattr(driver, "write", watched)
    with pytest.raises(ZeroDivisionError):
        run(driver, Swing(40, lambda: (failed.append(True), fail())), duration=1.0)
    assert {safe.reason for safe in after} == {Reason(Code.PROGRAM_FAILED, "ZeroDivisionError: on purpose")}
    assert len(after) < 0.5 * REST / driver.period
    assert not after[-1].velocity.any()


def test_45_a_robot_that_nobody_moves_is_not_brought_to_rest(world: World) -> None:
    world.reset()
    with SimulatedDriver(world.robot, world=world, arm=False) as driver:
        with pytest.raises(ZeroDivisionError) as raised:
            run(driver, Swing(5, fail), duration=1.0, write=False)
        assert not hasattr(raised.value, "__notes__")
        assert driver.gate.counts.steps == 5


def test_a_run_perceives_with_the_settings_that_it_is_given(world: World) -> None:
    world.reset()
    slow = BodySettings(conditioning=ConditioningSettings(latency=0.02))
    seen: list[ConditioningSettings] = []

    class Looks(Still):
        def init(self, body: GenericBody) -> int:
            seen.append(body.settings.conditioning)
            return super().init(body)

    with SimulatedDriver(world.robot, world=world) as driver:
        run(driver, Looks(), duration=0.01, settings=slow)
    assert seen == [slow.conditioning]


def test_45_a_robot_that_was_not_armed_is_not_brought_to_rest(world: World) -> None:
    world.reset()
    with SimulatedDriver(world.robot, world=world, arm=False) as driver:
        with pytest.raises(DriverError) as raised:
            run(driver, Swing(), duration=1.0)
        assert not hasattr(raised.value, "__notes__")
        assert driver.gate.counts.steps == 1


def test_45_a_driver_that_fails_to_read_in_any_way_is_still_brought_to_rest(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast: list[float] = []

    def observe(tick: Tick) -> None:
        fast.append(speed(driver))
        if len(fast) == 40:
            monkeypatch.setattr(driver, "_receive", fail)

    with pytest.raises(ZeroDivisionError) as raised:
        run(driver, Swing(), duration=1.0, observe=observe)
    assert fast[-1] > 0.3
    assert not hasattr(raised.value, "__notes__")
    monkeypatch.undo()
    driver.world.advance(driver.world.time + 0.05)
    assert speed(driver) < 0.02


def test_45_an_exception_of_an_observer_stops_the_robot(driver: SimulatedDriver) -> None:
    def observe(tick: Tick) -> None:
        if tick.now > 0.05:
            fail()

    with pytest.raises(ZeroDivisionError):
        run(driver, Swing(), duration=1.0, observe=observe)
    assert driver.gate.state is GateState.STOP


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_an_exception_of_a_thread_stops_the_robot_and_is_raised(driver: SimulatedDriver) -> None:
    def spawn() -> None:
        thread = threading.Thread(target=fail, name="helper")
        thread.start()
        thread.join()

    report = LoopReport()
    with pytest.raises(ZeroDivisionError):
        run(driver, Swing(40, spawn), duration=1.0, report=report)
    assert driver.gate.state is GateState.STOP
    assert "thread helper" in report.ended
    assert report.ticks == 41


@pytest.mark.parametrize(
    ("number", "error", "ended"),
    [(signal.SIGINT, KeyboardInterrupt, "Ctrl-C"), (signal.SIGTERM, SystemExit, "SystemExit: 143")],
)
def test_42_a_signal_brings_the_robot_to_rest(
    driver: SimulatedDriver, number: int, error: type[BaseException], ended: str
) -> None:
    before, report = signal.getsignal(number), LoopReport()
    with pytest.raises(error):
        run(driver, Swing(40, lambda: os.kill(os.getpid(), number)), duration=1.0, report=report)
    assert report.ended == ended
    assert driver.world.time < 0.1 + 0.5
    driver.world.advance(driver.world.time + 0.05)
    assert speed(driver) < 0.02
    assert signal.getsignal(number) is before


def test_42_more_signals_do_not_interrupt_the_stop(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Users often press Ctrl-C twice, or a wrapper forwards the signal. In an earlier version, the last
    command then had full speed."""
    read, write, sent = driver.read, driver.write, []

    def interrupt() -> None:
        os.kill(os.getpid(), signal.SIGINT)

    def impatient() -> Reading:
        if len(sent) > 41:
            interrupt()
        return read()

    def watched(safe: SafeCommand) -> SafeCommand:
        sent.append(safe)
        return write(safe)

    monkeypatch.setattr(driver, "read", impatient)
    monkeypatch.setattr(driver, "write", watched)
    with pytest.raises(KeyboardInterrupt):
        run(driver, Swing(40, interrupt), duration=1.0)
    assert np.abs(sent[41].velocity).max() > 0.3
    assert len(sent) > 50
    assert not sent[-1].velocity.any()


class Spin(Swing):
    """Moves the head at a constant velocity, with a command in each step."""

    def begin(self, perception: Perception, body: GenericBody) -> tuple[SwitchMode, ...]:
        return (SwitchMode("head", Mode.VELOCITY),)

    def step(
        self, memory: int, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], int]:
        velocity = np.zeros(perception.posture["head"].size)
        velocity[0] = 0.4
        return (GenericCommand("head", Mode.VELOCITY, velocity),), memory + 1


@pytest.mark.parametrize("capability", [Swing(), Spin()], ids=["position", "velocity"])
@pytest.mark.parametrize("until", [None, lambda memory: memory == 50], ids=["duration", "until"])
def test_a_run_that_is_over_leaves_no_joint_in_motion(
    driver: SimulatedDriver,
    monkeypatch: pytest.MonkeyPatch,
    capability: Swing,
    until: Callable[[int], bool] | None,
) -> None:
    """Otherwise the joint would continue to move: over YARP a velocity command has no end."""
    write, sent = driver.write, []

    def watched(safe: SafeCommand) -> SafeCommand:
        sent.append(safe)
        return write(safe)

    monkeypatch.setattr(driver, "write", watched)
    report = LoopReport()
    run(driver, capability, duration=0.1, until=until, report=report)
    assert (report.ticks, report.ended, report.cut_short) == (50, "done", True)
    assert report.to_json()["cut_short"] is True
    assert np.abs(sent[49].velocity).max() > 0.2
    assert not sent[-1].velocity.any()
    assert [(safe.state, safe.reason) for safe in sent[-2:]] == [
        (GateState.HOLD, Reason(Code.RUN_ENDED, "the run has ended")),
        (GateState.RUN, None),
    ]
    assert len(sent) < 50 + 0.5 * REST / driver.period
    assert driver.gate.state is GateState.RUN, "whoever goes on is not refused"
    count = len(sent)
    report = LoopReport()
    run(driver, Still(), duration=0.1, report=report)
    assert not report.cut_short
    assert sent[count].state is GateState.RUN
    assert len(sent) == count + 50, "what rests is not brought to rest"


def test_what_holds_a_robot_elsewhere_is_over_when_a_run_has_ended(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process of the robot receives the end of the hold later."""
    read, reads = driver.read, 0

    def held() -> Reading:
        nonlocal reads
        reads += 1
        if 50 < reads <= 150:
            driver.gate.hold("the robot's process: holds")
        return read()

    monkeypatch.setattr(driver, "read", held)
    run(driver, Spin(), duration=0.1)
    assert reads == 151
    assert driver.gate.state is GateState.RUN


def test_a_robot_that_does_not_come_to_rest_is_not_waited_for(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop normally waits up to `REST` for rest and up to `REST` for the end of a hold. Here `REST` is
    0."""
    monkeypatch.setattr("tci.runtime.control.REST", 0.0)
    report = LoopReport()
    run(driver, Spin(), duration=0.1, report=report)
    assert (report.ended, report.cut_short) == ("done", True)
    assert driver.gate.counts.steps == 50


@pytest.mark.parametrize("answer", [None, [(), 1], ((), 1, 2)], ids=["nothing", "a list", "three"])
def test_a_step_that_gives_no_pair_is_told_what_to_give(driver: SimulatedDriver, answer: object) -> None:
    class Odd(Swing):
        def step(
            self, memory: int, perception: Perception, body: GenericBody
        ) -> tuple[tuple[Order, ...], int]:
            return answer

    with pytest.raises(CommandError, match=f"Odd: step returned {type(answer).__name__}; valid: the pair"):
        run(driver, Odd(), duration=0.1)
    assert driver.gate.state is GateState.STOP


def test_a_run_that_writes_nothing_does_not_begin_when_it_fails(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gate's references moved but the robot did not, so the robot would jump if a later run began at the
    references."""
    sent: list[SafeCommand] = []
    monkeypatch.setattr(driver, "write", sent.append)
    with pytest.raises(ZeroDivisionError):
        run(driver, Swing(40, fail), duration=1.0, write=False)
    run(driver, Swing(), duration=0.1, write=False)
    assert not sent


def test_26_a_second_commander_is_refused_and_the_first_goes_on(driver: SimulatedDriver) -> None:
    other = SimulatedDriver(driver.robot, world=driver.world)

    def intrude() -> None:
        with pytest.raises(DriverError, match=f"commanded by process {os.getpid()}"):
            run(other, Swing(), duration=0.1)

    assert run(driver, Swing(40, intrude), duration=0.2).memory == 100
    assert driver.gate.state is GateState.RUN


def test_26_a_lease_is_free_again_after_its_holder() -> None:
    for _ in range(2):
        with lease("nobody's robot"):
            pass


def test_a_run_of_no_time_misses_nothing(driver: SimulatedDriver) -> None:
    report = LoopReport()
    run(driver, Swing(), duration=0.0, report=report)
    assert (report.ticks, report.missed, report.ended) == (0, 0, "done")


def test_what_was_read_is_told_before_anything_is_made_of_it(driver: SimulatedDriver) -> None:
    said: list[tuple[str, object]] = []
    run(
        driver, Swing(2, lambda: said.append(("step", None))), duration=0.01,
        sensed=lambda reading: said.append(("sensed", reading)),
        observe=lambda tick: said.append(("tick", tick.reading)),
    )  # fmt: skip
    assert [word for word, _ in said] == ["sensed", "tick"] * 2 + ["sensed", "step", "tick"] + [
        "sensed",
        "tick",
    ] * 2
    readings = [what for word, what in said if word != "step"]
    assert all(one is other for one, other in zip(readings[::2], readings[1::2], strict=True))


@pytest.mark.parametrize(("after", "missed"), [(148, 1), (146, 3), (149, 0)])
def test_41_periods_that_are_missed_at_the_end_are_counted(
    driver: SimulatedDriver, after: int, missed: int
) -> None:
    report = LoopReport()

    def oversleep() -> None:
        driver.world.advance(driver.world.time + 8.5 * driver.period)

    run(driver, Swing(after, oversleep), duration=0.3, report=report)
    assert report.ticks + report.missed == 150
    assert (report.missed, report.overruns) == (missed, missed > 0)
    assert 0.0 < report.work.largest < 30.0


def test_41_periods_that_are_missed_during_a_run_and_at_its_end_are_added(driver: SimulatedDriver) -> None:
    report = LoopReport()

    def oversleep(tick: Tick) -> None:
        if report.ticks in (50, 139):
            driver.world.advance(driver.world.time + 8.5 * driver.period)

    run(driver, Still(), duration=0.3, report=report, observe=oversleep)
    assert report.overruns == 2
    assert report.ticks + report.missed == 150


@pytest.mark.parametrize("missed", [2, 3])
def test_41_periods_that_are_missed_are_counted_and_many_mean_hold(
    driver: SimulatedDriver, missed: int
) -> None:
    report = LoopReport()
    seen: list[Tick] = []

    def oversleep() -> None:
        driver.world.advance(driver.world.time + (missed + 1.5) * driver.period)

    run(driver, Swing(40, oversleep), duration=0.3, report=report, observe=seen.append)
    assert (report.overruns, report.missed) == (1, missed)
    assert report.ticks == 150 - missed == report.work.counts.sum()
    held = [tick.sent for tick in seen if tick.sent.state is GateState.HOLD]
    assert len(held) == (missed >= 3)
    assert all("missed" in str(sent.reason) for sent in held)
    assert seen[-1].sent.state is GateState.RUN


def test_28_a_guard_makes_the_robot_hold_as_long_as_it_says(driver: SimulatedDriver) -> None:
    reasons = iter([None] * 50 + [Reason(Code.HEARTBEAT_MISSING, "no viewer")] * 20 + [None] * 80)
    states: list[GateState] = []
    run(
        driver,
        Swing(),
        duration=0.3,
        guard=lambda: next(reasons),
        observe=lambda tick: states.append(tick.sent.state),
    )
    assert states == [GateState.RUN] * 50 + [GateState.HOLD] * 20 + [GateState.RUN] * 80


def test_40_the_garbage_collector_is_as_before_after_a_run(driver: SimulatedDriver) -> None:
    frozen: list[int] = []
    run(driver, Swing(3, lambda: frozen.append(gc.get_freeze_count())), duration=0.05)
    assert frozen[0] > 1000
    assert gc.get_freeze_count() == 0
    gc.freeze()
    try:
        with frozen_garbage():
            pass
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


def test_40_what_was_there_before_a_run_costs_no_collection_in_it(driver: SimulatedDriver) -> None:
    ballast: list[list[object]] = [[] for _ in range(200_000)]
    looked_at: list[int] = []
    run(driver, Swing(3, lambda: looked_at.append(len(gc.get_objects()))), duration=0.05)
    run(driver, Swing(900, lambda: looked_at.append(len(gc.get_objects()))), duration=2.0)
    assert len(ballast) < len(gc.get_objects())
    assert max(looked_at) < 20_000  # and the number does not grow


def test_the_report_tells_quantiles_in_milliseconds() -> None:
    report = LoopReport()
    for microseconds in range(1, 1001):
        report.work.add(microseconds * 1e-6)
    figures = report.to_json()["work_ms"]
    assert figures["p50"] == pytest.approx(0.512)
    assert figures["p99"] == figures["max"] == pytest.approx(1.0)


def test_quantiles_of_the_report_are_those_of_its_names() -> None:
    report = LoopReport()
    for seconds, count in ((1e-4, 10_000), (1e-3, 50), (1e-2, 5)):
        for _ in range(count):
            report.work.add(seconds)
    figures = report.to_json()["work_ms"]
    assert figures["p50"] == figures["p99"] == pytest.approx(0.1, rel=0.3)
    assert figures["p999"] == pytest.approx(1.0, rel=0.3)
    assert figures["max"] == pytest.approx(10.0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_a_thread_that_is_gone_when_it_fails_has_no_name() -> None:
    told = threading.ExceptHookArgs((ZeroDivisionError, ZeroDivisionError("on purpose"), None, None))
    with interruptions() as found:
        threading.excepthook(told)
    assert found.thread == "a thread"
    with pytest.raises(ZeroDivisionError):
        found.raise_it()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_loops_side_by_side_all_see_a_failing_thread() -> None:
    before = threading.excepthook
    with ExitStack() as first:
        one = first.enter_context(interruptions())
        with interruptions() as other:
            first.close()  # the first sound ends while the second continues
            thread = threading.Thread(target=lambda: 1 / 0, name="helper")
            thread.start()
            thread.join()
            assert one.failure is None
            with pytest.raises(ZeroDivisionError):
                other.raise_it()
    assert threading.excepthook is before


def test_the_run_ends_when_the_memory_is_as_wanted(driver: SimulatedDriver) -> None:
    report = LoopReport()
    assert run(driver, Swing(), duration=1.0, until=lambda memory: memory == 7, report=report).memory == 7
    assert (report.ticks, report.ended) == (7, "done")


def test_a_fault_that_the_capability_sees_stops_the_robot(driver: SimulatedDriver) -> None:
    class Blind(Swing):
        def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
            return Reason(Code.SKIN_BLIND, "I see nothing") if perception.stamp > 0.1 else None

    run(driver, Blind(), duration=0.5)
    assert driver.gate.state is GateState.STOP
    assert driver.gate.reason == Reason(Code.SKIN_BLIND, "I see nothing")
    assert driver.world.time > 0.4, "it goes on, at rest"
    assert speed(driver) < 0.02


def test_a_capability_that_cannot_begin_is_an_error_and_nothing_moves(driver: SimulatedDriver) -> None:
    class Eager(Swing):
        def begin(self, perception: Perception, body: GenericBody) -> tuple[GenericCommand, ...]:
            parts = ("head", "left_arm")
            return tuple(
                GenericCommand(part, Mode.TORQUE, np.zeros(perception.posture[part].size)) for part in parts
            )

    before = driver.read().joints.position
    words = r"\w+ is in position mode, the command is in torque mode; valid: switch the mode first"
    with pytest.raises(CommandError, match=f"^Eager can't begin: {words}; {words}$"):
        run(driver, Eager(), duration=0.5)
    np.testing.assert_allclose(driver.read().joints.position, before, atol=1e-3)


def test_an_order_that_does_not_fit_is_told_with_the_refusals_and_the_others_pass(
    driver: SimulatedDriver,
) -> None:
    class Wrong(Swing):
        def step(
            self, memory: int, perception: Perception, body: GenericBody
        ) -> tuple[tuple[GenericCommand, ...], int]:
            good, memory = super().step(memory, perception, body)
            return (GenericCommand("head", Mode.POSITION, np.zeros(7)), *good), memory

    ticks: list[Tick] = []
    run(driver, Wrong(), duration=0.05, observe=ticks.append)
    assert ticks[0].skin is ticks[0].perception.skin
    assert "7" in ticks[0].sent.refusals[0].text
    assert len(ticks[0].sent.refusals) == 1
    assert speed(driver) > 0.05


def test_45_a_robot_that_cannot_be_written_to_is_named_beside_the_first_error(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(safe: object) -> None:
        raise OSError("the wire is cut")

    def cut() -> None:
        monkeypatch.setattr(driver, "_send", gone)
        fail()

    with pytest.raises(ZeroDivisionError) as raised:
        run(driver, Swing(40, cut), duration=1.0)
    assert raised.value.__notes__ == ["and the robot could not be brought to rest: the wire is cut"]
    assert driver.gate.state is GateState.STOP


def test_45_a_driver_that_is_only_read_is_not_written_to_at_the_end(world: World) -> None:
    world.reset()
    with SimulatedDriver(world.robot, world=world, arm=False) as driver:
        with pytest.raises(ZeroDivisionError):
            run(driver, Swing(5, fail), duration=1.0, write=False)
        assert world.time < 0.05


def test_15_skin_that_does_not_fit_is_not_seen_and_stops_the_robot_only_if_that_lasts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    driver, report, wrong = SimulatedDriver(tci.load_robot("nao")), LoopReport(), [False]
    read, begins, steps, states = driver.read, [], [], []

    def cut() -> Reading:
        reading = read()
        if not wrong[0]:
            return reading
        return replace(reading, skin=tuple(replace(frame, values=frame.values[1:]) for frame in reading.skin))

    class Watch(Swing):
        def begin(self, perception: Perception, body: GenericBody) -> tuple[()]:
            begins.append(driver.world.time)
            return ()

        def step(
            self, memory: int, perception: Perception, body: GenericBody
        ) -> tuple[tuple[GenericCommand, ...], int]:
            steps.append(driver.world.time)
            return super().step(memory, perception, body)

    def observe(tick: Tick) -> None:
        states.append(tick.sent.state)
        wrong[0] = begin + 0.1 <= tick.now < begin + 0.1 + spoilt

    monkeypatch.setattr(driver, "read", cut)
    begin, spoilt = driver.world.time, 0.5 * PERSISTS
    run(driver, Watch(), duration=0.3, observe=observe, report=report)
    assert 0.6 * spoilt / driver.period < report.rejected <= spoilt / driver.period + 1
    assert len(steps) == report.ticks - report.rejected, "the capability sees none of it"
    assert len(begins) == 1, "the capability does not begin again"
    assert set(states) == {GateState.RUN}
    states.clear()
    begin, spoilt = driver.world.time, 1.0
    run(driver, Watch(), duration=0.4, observe=observe, report=LoopReport())
    assert 0.1 + PERSISTS < states.index(GateState.STOP) * driver.period < 0.1 + PERSISTS + 0.03
    assert "expected (240,)" in str(driver.gate.step((), read().joints, driver.world.time).reason)


def test_10_skin_that_stands_still_makes_the_robot_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    with SimulatedDriver(
        tci.load_robot("nao"), world=World(tci.load_robot("nao"), skin=["left_forearm"])
    ) as driver:
        receive = driver._receive
        skin = receive().skin
        monkeypatch.setattr(driver, "_receive", lambda: replace(receive(), skin=skin))
        states: list[tuple[float, GateState]] = []
        run(driver, Swing(), duration=0.4, observe=lambda tick: states.append((tick.now, tick.sent.state)))
    assert len(states) > 100
    assert {state for now, state in states if now < LEAST_SILENCE} == {GateState.RUN}
    assert {state for now, state in states if now > LEAST_SILENCE + 0.01} == {GateState.HOLD}


def test_41_every_period_counts_once_wherever_in_it_the_loop_wakes() -> None:
    class Shaky(ManualClock):
        """A clock that advances with every reading and whose waits end late, by up to two periods."""

        def now(self) -> float:
            self.advance(2e-5)
            return super().now()

        def sleep_until(self, stamp: float) -> None:
            almost = random.random() < 0.1
            super().sleep_until(stamp + driver.period * (0.999 if almost else 2.0 * random.random() ** 4))

    random, report = np.random.default_rng(1), LoopReport()
    driver = FakeDriver("nao", clock=Shaky(70_000.0))
    run(driver, Swing(), duration=2000 * driver.period, report=report)
    assert report.missed > 100
    assert report.ticks + report.missed == 2000


def test_a_first_period_that_begins_late_is_none_that_was_missed(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks, report = driver.ticks, LoopReport()

    def late(*, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        del start
        driver.world.advance(0.1)
        yield from ticks(duration=duration)

    monkeypatch.setattr(driver, "ticks", late)
    run(driver, Swing(), duration=0.1, report=report)
    assert (report.ticks, report.missed, report.overruns) == (50, 0, 0)
    assert report.lateness.largest < driver.period / 2


def test_45_a_robot_that_cannot_come_to_rest_is_waited_for_and_not_longer(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = driver.gate.step

    def restless(*args: Any, **options: Any) -> Any:
        return replace(step(*args, **options), velocity=np.ones(3))

    def go_on() -> None:
        monkeypatch.setattr(driver.gate, "step", restless)
        monkeypatch.setattr(driver, "write", lambda safe: safe)
        fail()

    begun = driver.world.time
    with pytest.raises(ZeroDivisionError):
        run(driver, Swing(5, go_on), duration=1.0)
    assert REST <= driver.world.time - begun < REST + 0.1


def test_the_report_as_json_has_every_figure_under_its_name() -> None:
    report = LoopReport(ticks=5, missed=4, overruns=3, rejected=2, ended="done")
    for seconds in (1e-3, 1e-3, 4e-3):
        report.work.add(seconds)
    plain = report.to_json()
    assert {name: plain[name] for name in ("ticks", "missed", "overruns", "rejected", "ended")} == {
        "ticks": 5, "missed": 4, "overruns": 3, "rejected": 2, "ended": "done",
    }  # fmt: skip
    assert plain["work_ms"] == {
        "p50": pytest.approx(1.0, rel=0.1), "p99": 4.0, "p999": 4.0, "max": 4.0,
    }  # fmt: skip
    assert plain["lateness_ms"] == {"p50": 0.0, "p99": 0.0, "p999": 0.0, "max": 0.0}


BEGIN = 10.0007


def timed(driver: SimulatedDriver, periods: Sequence[float]) -> tuple[list[Moment], LoopReport]:
    """Begins at `BEGIN`, and then wakes at each of `periods` after it. Returns what it observed."""
    report, period = LoopReport(), driver.period
    driver.world.advance(BEGIN)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(driver.clock, "now", lambda: BEGIN)
        times = [BEGIN + number * period for number in periods]
        patched.setattr(driver, "ticks", lambda **_: iter(times))
        return [*Control(driver, report=report).periods()], report


def test_41_what_was_missed_is_counted_gap_by_gap_and_told_with_its_code(driver: SimulatedDriver) -> None:
    moments, report = timed(driver, (2.5, 3.0, 4.0, 6.0, 10.0, 13.25, 17.0))
    words = Reason(Code.PERIODS_MISSED, "the loop missed 3 periods")
    assert [missed_periods(moment) for moment in moments] == [None] * 4 + [words, None, words]
    assert (report.overruns, report.missed) == (4, 1 + 3 + 2 + 3)
    assert report.lateness.counts.sum() == len(moments)
    assert report.lateness.largest == pytest.approx(0.5 * driver.period, rel=1e-3)


def test_41_lateness_is_counted_from_the_beginning_of_the_period(driver: SimulatedDriver) -> None:
    _, report = timed(driver, [number + 0.25 for number in range(5)])
    assert report.lateness.largest == pytest.approx(0.25 * driver.period, rel=1e-3)
    assert report.lateness.quantile(0.5) == pytest.approx(0.25 * driver.period, rel=0.05)


def test_times_above_the_finest_one_are_told_apart() -> None:
    times = Histogram()
    for share in (1.0, 1.5, 2.5):
        times.add(share * FINEST)
    assert times.quantile(0.3) == FINEST
    assert times.quantile(0.6) == pytest.approx(1.5 * FINEST, rel=0.05)


def test_a_time_beyond_all_bins_is_counted_in_the_last_one() -> None:
    times = Histogram()
    for seconds in (1e9, 1e-9):
        times.add(seconds)
    assert np.flatnonzero(times.counts).tolist() == [0, len(times.counts) - 1]
    assert np.issubdtype(times.counts.dtype, np.integer)
    assert times.to_json()["max"] == 1e12


def test_an_invalid_duration_is_refused_before_anything_is_sent(driver: SimulatedDriver) -> None:
    with pytest.raises(TciError, match="duration"):
        run(driver, Still(), duration=-1.0)
    assert driver.gate.counts.steps == 0


def test_a_run_that_writes_nothing_cuts_no_motion_short(world: World) -> None:
    world.reset()
    report = LoopReport()
    with SimulatedDriver(world.robot, world=world, arm=False) as driver:
        run(driver, Swing(), duration=0.1, write=False, report=report)
        assert driver.gate.counts.steps == report.ticks
    assert not report.cut_short


def test_a_capability_gets_the_body_of_its_robot_in_each_step(driver: SimulatedDriver) -> None:
    bodies: list[GenericBody] = []

    class Asks(Still):
        def init(self, body: GenericBody) -> int:
            bodies.append(body)
            return 0

        def begin(self, perception: Perception, body: GenericBody) -> tuple[()]:
            bodies.append(body)
            return ()

        def step(
            self, memory: int, perception: Perception, body: GenericBody
        ) -> tuple[tuple[GenericCommand, ...], int]:
            bodies.append(body)
            return (), memory + 1

        def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
            bodies.append(body)
            return None

    run(driver, Asks(), duration=0.01)
    assert [body.robot for body in bodies] == [driver.robot] * 12


def test_a_tick_has_the_orders_of_the_capability(driver: SimulatedDriver) -> None:
    ticks: list[Tick] = []
    run(driver, Swing(), duration=0.01, observe=ticks.append)
    assert [len(tick.commands) for tick in ticks] == [1, 0, 0, 0, 0]
    assert ticks[0].commands[0].part == "head"


def test_skin_of_a_sender_that_omits_equal_frames_is_seen_as_if_none_were_omitted() -> None:
    seen: list[list[list[int]]] = []
    for keep_alive in (None, 0.2):
        with tci.connect("nao", "sim", arm=True, keep_alive=keep_alive) as driver:
            seen.append([])
            run(
                driver,
                Still(),
                duration=0.3,
                observe=lambda tick: seen[-1].append(tick.skin.sequence.tolist()),
            )
    assert seen[0] == seen[1]


def test_45_a_robot_at_rest_gets_the_last_command_more_often_than_messages_are_missed(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, sent = driver.write, []

    def watched(safe: SafeCommand) -> SafeCommand:
        sent.append(safe)
        return write(safe)

    monkeypatch.setattr(driver, "write", watched)
    with pytest.raises(ZeroDivisionError):
        run(driver, Still(), duration=1.0, observe=lambda tick: fail() if len(sent) == 5 else None)
    assert [safe.state for safe in sent[5:]] == [GateState.STOP] * (MISSED + 1)


def test_45_a_robot_that_was_never_read_is_not_brought_to_rest(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "_receive", fail)
    with pytest.raises(ZeroDivisionError) as raised:
        run(driver, Still(), duration=1.0)
    assert not hasattr(raised.value, "__notes__")
    assert driver.gate.counts.steps == 0


def test_skin_that_is_sent_only_when_it_changes_is_waited_for(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "info", replace(driver.info, keep_alive=2.0))
    _, silence, *_ = usual_watchdogs(driver)
    joints, frame = driver.read().joints, SkinFrame(driver.robot.patches[0].name, 0.0, 0, np.zeros(4))
    assert silence(Moment(0.0, Reading(joints, (frame,)))) is None
    assert silence(Moment(5.9, Reading(joints, ()))) is None
    assert silence(Moment(6.1, Reading(joints, ())))
