"""Faults while somebody touches a robot that teaches, is gentle, attends or listens. The names of the tests
contain the number of the fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import tci
from tci.capabilities import TouchWord, TouchWords
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.runtime.loop import Tick, run
from tci.simulation.world import World

AT, LATE, END = 0.8, 0.2, 2.0
"""When a fault begins, how long late data are late, and the end [s]: the touch lasts from 0.4 to 1.2 s."""
TOUCH = "press 'left forearm' 2N 0.8s @0.4s"
MOST = 15.0
"""Force [N] that a hand gets at most that leads an arm, or meets one, which halts under it: what teaching
declares. It presses with 2 N."""
NOISE = 1.0
"""Force [N] by which two touches of a hand differ that meet an arm at rest."""


class Reach(tci.Capability[bool]):
    """Moves the left arm forward, once."""

    def init(self, body: tci.GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], bool]:
        goal = perception.posture["left_arm"] + np.array([0.5, 0.0, 0.0, 0.0, 0.0])
        return (() if memory else (GenericCommand("left_arm", Mode.POSITION, goal, 0.3),)), True


LIBRARY: dict[str, Callable[[], tci.Capability[Any]]] = {
    "teach": tci.Teach,
    "gentle": lambda: tci.Gentle(Reach()),
    "attend": tci.Attend,
    "words": TouchWords,
}


@dataclass
class Rehearsed:
    ticks: list[Tick]
    force: float
    """Largest force [N] on the person."""
    words: list[TouchWord]


@cache
def world() -> World:
    return World("nao", people=1)


@cache
def rehearsed(name: str, fault: str, lasts: float) -> Rehearsed:
    """A hand presses the left forearm meanwhile; no fault without a name."""
    world().reset()
    world().touch(TOUCH)
    ticks, words = list[Tick](), list[TouchWord]()

    def hear(memory: Any) -> bool:
        words.extend(getattr(memory, "new", ()))
        return False

    faults = [FaultPlan(fault, AT, lasts)] if fault else []
    driver = SimulatedDriver(world().robot, world=world())
    run(FaultInjector(driver, faults), LIBRARY[name](), duration=END, observe=ticks.append, until=hear)
    return Rehearsed(ticks, max(one.peak_force for one in world().person().hands), words)


def presses_nobody(name: str, done: Rehearsed) -> bool:
    """The person gets no more than `MOST` and, where nothing moves the arm, than without the fault."""
    rests = name in ("attend", "words")
    return done.force <= (rehearsed(name, "", 0.0).force + NOISE if rests else MOST)


def rests(ticks: list[Tick], begin: float) -> bool:
    return all(not np.abs(one.sent.velocity).max(initial=0.0) > 1e-9 for one in ticks if one.now >= begin)


@pytest.mark.parametrize("name", LIBRARY)
def test_10_late_data_hold_the_robot_and_it_goes_on(name: str) -> None:
    done = rehearsed(name, "dropped-frames", LATE)
    held = [one.now for one in done.ticks if one.sent.state is GateState.HOLD]
    assert held
    assert AT < held[0] < AT + 0.1
    assert held[-1] < AT + LATE + 0.02
    assert done.ticks[-1].sent.state is GateState.RUN
    late = [one for one in done.ticks if one.sent.state is GateState.HOLD and one.commands]
    assert all(one.sent.refusals for one in late), "what is ordered meanwhile is not done later"
    assert presses_nobody(name, done)
    assert [one.word for one in done.words] == [one.word for one in rehearsed(name, "", 0.0).words]


@pytest.mark.parametrize("name", LIBRARY)
@pytest.mark.parametrize(("fault", "within"), [("dropped-frames", 0.1), ("skin-silent", 0.3)])
def test_10_28_a_cut_link_holds_the_robot(name: str, fault: str, within: float) -> None:
    done = rehearsed(name, fault, END)
    held = next(one.now for one in done.ticks if one.sent.state is GateState.HOLD)
    assert held < AT + within
    assert {one.sent.state for one in done.ticks if one.now >= held} == {GateState.HOLD}
    assert rests(done.ticks, held + 0.5)
    assert presses_nobody(name, done)
    assert not done.words, "nothing is told of a touch whose end nobody felt"


@pytest.mark.parametrize("name", LIBRARY)
def test_14_joints_that_are_stuck_stop_a_robot_that_moves(name: str) -> None:
    """And one that rests, since it can't know."""
    done = rehearsed(name, "frozen-source", END)
    stopped = next(one.now for one in done.ticks if one.sent.state is GateState.STOP)
    assert stopped < AT + 0.15
    assert {one.sent.state for one in done.ticks if one.now >= stopped} == {GateState.STOP}
    assert rests(done.ticks, stopped + 0.5)
    assert presses_nobody(name, done)


@pytest.mark.parametrize("name", LIBRARY)
def test_04_an_angle_that_is_no_number_holds_the_robot_and_it_goes_on(name: str) -> None:
    done = rehearsed(name, "nan-angle", LATE)
    held = [one.now for one in done.ticks if one.sent.state is GateState.HOLD]
    assert AT - 1e-9 <= held[0] < AT + 0.01
    assert held[-1] < AT + LATE + 0.01
    assert done.ticks[-1].sent.state is GateState.RUN
    assert presses_nobody(name, done)
    assert [one.word for one in done.words] == [one.word for one in rehearsed(name, "", 0.0).words]


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("teach", "nan-taxel"), ("attend", "out-of-order"), ("words", "nan-taxel"),
        ("words", "out-of-order"), ("words", "duplicates"), ("words", "clock-jump"),
    ],
)  # fmt: skip
def test_04_11_12_13_a_touch_is_answered_as_without(name: str, fault: str) -> None:
    done, without = rehearsed(name, fault, LATE), rehearsed(name, "", 0.0)
    assert {one.sent.state for one in done.ticks} == {GateState.RUN}
    assert done.force <= without.force + NOISE
    assert [one.word for one in done.words] == [one.word for one in without.words]


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("teach", "taxel-stuck-high"), ("teach", "dead-patch"), ("gentle", "saturated-taxel"),
        ("gentle", "dead-patch"), ("attend", "saturated-taxel"),
        ("words", "saturated-taxel"), ("words", "baseline-step"),
    ],
)  # fmt: skip
def test_01_03_05_07_skin_that_is_wrong_presses_nobody(name: str, fault: str) -> None:
    """What they feel may be wrong, and is one touch at most."""
    done = rehearsed(name, fault, LATE)
    assert {one.sent.state for one in done.ticks} == {GateState.RUN}
    assert presses_nobody(name, done)
    assert len(done.words) <= 1


@pytest.mark.parametrize(
    ("name", "fault", "within"),
    [
        ("teach", "wrong-taxel-count", 0.15), ("gentle", "wrong-type", 0.15), ("words", "wrong-type", 0.15),
        ("teach", "wrong-direction", 0.3), ("attend", "wrong-direction", 0.3),
        ("teach", "stale-encoder", 0.4), ("attend", "stale-encoder", 0.4), ("attend", "servo-off", 0.02),
        ("gentle", "mode-mismatch", 0.55), ("teach", "encoder-step", 0.02),
    ],
)  # fmt: skip
def test_15_19_20_22_23_25_35_what_can_not_be_trusted_stops_the_robot(
    name: str, fault: str, within: float
) -> None:
    done = rehearsed(name, fault, END)
    stopped = next(one.now for one in done.ticks if one.sent.state is GateState.STOP)
    assert AT - 1e-9 <= stopped < AT + within
    assert {one.sent.state for one in done.ticks if one.now >= stopped} == {GateState.STOP}
    assert rests(done.ticks, stopped + 0.5)
    assert presses_nobody(name, done)


@pytest.mark.parametrize("name", ["teach", "attend"])
def test_21_what_is_blocked_goes_back_and_rests(name: str) -> None:
    done = rehearsed(name, "stall", END)
    assert {one.sent.state for one in done.ticks} == {GateState.RUN}
    assert any(one.sent.met for one in done.ticks if one.now > AT)
    assert rests(done.ticks, END - 0.2)
    assert presses_nobody(name, done)


@pytest.mark.parametrize("name", ["gentle", "words"])
def test_41_missed_periods_hold_the_robot_and_it_goes_on(name: str) -> None:
    done = rehearsed(name, "overrun", LATE)
    assert {one.sent.state for one in done.ticks} == {GateState.RUN, GateState.HOLD}
    assert done.ticks[-1].sent.state is GateState.RUN
    assert presses_nobody(name, done)
