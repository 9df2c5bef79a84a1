"""The loop when something goes wrong: it counts, holds, stops, and never ends with the robot in motion."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import pytest

import tci
from tci.errors import LinkError
from tci.interface.gate import GateState
from tci.messages import GenericCommand, Mode, Perception
from tci.middleware.simulated import SimulatedLink
from tci.runtime.guards import frozen_garbage, interruptions
from tci.runtime.lease import lease
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.simulation.world import World


class Swing(tci.Capability[int]):
    """Sends the head far away at once, and may do something at its `at`-th step."""

    def __init__(self, at: int = -1, what: Callable[[], object] = int) -> None:
        self.at, self.what = at, what

    def init(self) -> int:
        return 0

    def step(self, memory: int, perception: Perception) -> tuple[tuple[GenericCommand, ...], int]:
        if memory == self.at:
            self.what()
        target = perception.posture["head"].copy()
        target[0] += 0.4
        commands = () if memory else (GenericCommand("head", Mode.POSITION, target),)
        return commands, memory + 1


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"), skin=False)


@pytest.fixture
def link(world: World) -> SimulatedLink:
    world.reset()
    return SimulatedLink(world.robot, world=world)


def fail() -> None:
    raise ZeroDivisionError("on purpose")


def speed(link: SimulatedLink) -> float:
    return float(np.abs(link.read().joints.velocity).max())


def test_45_an_exception_of_the_capability_stops_the_robot_and_is_raised(link: SimulatedLink) -> None:
    report = LoopReport()
    fast: list[float] = []
    with pytest.raises(ZeroDivisionError):
        run(link, Swing(40, fail), duration=1.0, report=report, observe=lambda tick: fast.append(speed(link)))
    assert fast[-1] > 0.3
    assert link.gate.state is GateState.STOP
    assert report.ended == "ZeroDivisionError: on purpose"
    link.world.advance(link.world.time + 0.05)
    assert speed(link) < 0.02


def test_45_a_link_that_fails_to_read_in_any_way_is_still_brought_to_rest(
    link: SimulatedLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast: list[float] = []

    def observe(tick: Tick) -> None:
        fast.append(speed(link))
        if len(fast) == 40:
            monkeypatch.setattr(link, "_receive", fail)

    with pytest.raises(ZeroDivisionError) as raised:
        run(link, Swing(), duration=1.0, observe=observe)
    assert fast[-1] > 0.3
    assert not hasattr(raised.value, "__notes__")
    monkeypatch.undo()
    link.world.advance(link.world.time + 0.05)
    assert speed(link) < 0.02


def test_45_an_exception_of_an_observer_stops_the_robot(link: SimulatedLink) -> None:
    def observe(tick: Tick) -> None:
        if tick.now > 0.05:
            fail()

    with pytest.raises(ZeroDivisionError):
        run(link, Swing(), duration=1.0, observe=observe)
    assert link.gate.state is GateState.STOP


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_an_exception_of_a_thread_stops_the_robot_and_is_raised(link: SimulatedLink) -> None:
    def spawn() -> None:
        thread = threading.Thread(target=fail, name="helper")
        thread.start()
        thread.join()

    report = LoopReport()
    with pytest.raises(ZeroDivisionError):
        run(link, Swing(40, spawn), duration=1.0, report=report)
    assert link.gate.state is GateState.STOP
    assert "thread helper" in report.ended
    assert report.ticks == 41


@pytest.mark.parametrize(
    ("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_42_a_signal_brings_the_robot_to_rest(
    link: SimulatedLink, number: int, error: type[BaseException]
) -> None:
    before = signal.getsignal(number)
    with pytest.raises(error):
        run(link, Swing(40, lambda: os.kill(os.getpid(), number)), duration=1.0)
    assert link.world.time < 0.1 + 0.5
    link.world.advance(link.world.time + 0.05)
    assert speed(link) < 0.02
    assert signal.getsignal(number) is before


def test_26_a_second_commander_is_refused_and_the_first_goes_on(link: SimulatedLink) -> None:
    other = SimulatedLink(link.robot, world=link.world)

    def intrude() -> None:
        with pytest.raises(LinkError, match=f"commanded by process {os.getpid()}"):
            run(other, Swing(), duration=0.1)

    assert run(link, Swing(40, intrude), duration=0.2) == 100
    assert link.gate.state is GateState.RUN


def test_26_a_lease_is_free_again_after_its_holder() -> None:
    for _ in range(2):
        with lease("nobody's robot"):
            pass


@pytest.mark.parametrize("missed", [2, 3])
def test_41_periods_that_are_missed_are_counted_and_many_mean_hold(link: SimulatedLink, missed: int) -> None:
    report = LoopReport()
    seen: list[Tick] = []

    def oversleep() -> None:
        link.world.advance(link.world.time + (missed + 1.5) * link.period)

    run(link, Swing(40, oversleep), duration=0.3, report=report, observe=seen.append)
    assert (report.overruns, report.missed) == (1, missed)
    assert report.ticks == 150 - missed == report.work.counts.sum()
    held = [tick.sent for tick in seen if tick.sent.state is GateState.HOLD]
    assert len(held) == (missed >= 3)
    assert all("missed" in sent.reason for sent in held)
    assert seen[-1].sent.state is GateState.RUN


def test_28_a_guard_makes_the_robot_hold_as_long_as_it_says(link: SimulatedLink) -> None:
    reasons = iter([""] * 50 + ["no heartbeat of viewer"] * 20 + [""] * 80)
    states: list[GateState] = []
    run(
        link,
        Swing(),
        duration=0.3,
        guard=lambda: next(reasons),
        observe=lambda tick: states.append(tick.sent.state),
    )
    assert states == [GateState.RUN] * 50 + [GateState.HOLD] * 20 + [GateState.RUN] * 80


def test_40_the_garbage_collector_is_as_before_after_a_run(link: SimulatedLink) -> None:
    frozen: list[int] = []
    run(link, Swing(3, lambda: frozen.append(gc.get_freeze_count())), duration=0.05)
    assert frozen[0] > 1000
    assert gc.get_freeze_count() == 0
    gc.freeze()
    try:
        with frozen_garbage():
            pass
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


def test_the_report_tells_quantiles_in_milliseconds() -> None:
    report = LoopReport()
    for microseconds in range(1, 1001):
        report.work.add(microseconds * 1e-6)
    figures = report.to_json()["work_ms"]
    assert figures["p50"] == pytest.approx(0.512)
    assert figures["p99"] == figures["max"] == pytest.approx(1.0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_loops_side_by_side_all_see_a_failing_thread() -> None:
    before = threading.excepthook
    with ExitStack() as first:
        one = first.enter_context(interruptions())
        with interruptions() as other:
            first.close()  # the first one ends while the second goes on
            thread = threading.Thread(target=lambda: 1 / 0, name="helper")
            thread.start()
            thread.join()
            assert one.failure is None
            with pytest.raises(ZeroDivisionError):
                other.raise_it()
    assert threading.excepthook is before
