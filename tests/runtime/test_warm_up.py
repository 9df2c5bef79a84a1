"""In its spare time the loop keeps the code of a command in the processor's caches. Nothing else changes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.gate import SafeCommand
from tci.gate.gate import Gate
from tci.messages import GenericCommand, JointReading, Mode, MonotonicClock, Perception, Reading
from tci.robot.joint_map import initial_position
from tci.runtime.loop_report import LoopReport
from tci.runtime.warm_up import WARM_UP, WarmUp

PERIODS = 3 * WARM_UP + 3


class Standing(Driver):
    """A robot that does not move, in real time."""

    count = 0

    def _receive(self) -> Reading:
        self.count += 1
        here = np.array(initial_position(self.robot))
        return Reading(JointReading(self.clock.now(), self.count, here, 0.0 * here), ())

    def _send(self, safe: SafeCommand) -> None:
        return

    def _close(self) -> None:
        return


class Waiting(tci.Capability[None]):
    """Sends no commands, and calls a function in each step."""

    def __init__(self, wait: Callable[[], None]) -> None:
        self.wait = wait

    def init(self, body: GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], None]:
        self.wait()
        return (), None


@pytest.fixture
def warmed(monkeypatch: pytest.MonkeyPatch) -> list[WarmUp]:
    """Returns a list to which each step of a warm-up appends an item."""
    steps: list[WarmUp] = []
    step = WarmUp.step

    def seen(warm_up: WarmUp) -> None:
        steps.append(warm_up)
        step(warm_up)

    monkeypatch.setattr(WarmUp, "step", seen)
    return steps


def standing() -> Standing:
    robot, lease = tci.load_robot("nao"), f"standing:{os.getpid()}"
    return Standing(DriverInfo.of(robot, "sim", clock=MonotonicClock(), armed=True, lease_name=lease))


def test_a_loop_in_real_time_warms_up_in_its_spare_time(warmed: list[WarmUp]) -> None:
    driver, report = standing(), LoopReport()
    tci.run(driver, Waiting(lambda: None), duration=PERIODS * driver.period, report=report)
    assert 1 <= len(warmed) <= report.ticks // WARM_UP
    assert len({*warmed}) == 1


def test_a_loop_without_spare_time_does_not(warmed: list[WarmUp]) -> None:
    driver = standing()
    busy = Waiting(lambda: time.sleep(0.6 * driver.period))
    tci.run(driver, busy, duration=PERIODS * driver.period)
    assert not warmed


def test_a_simulation_and_a_loop_that_sends_nothing_do_not(warmed: list[WarmUp]) -> None:
    with tci.connect("nao", "sim") as driver:
        tci.run(driver, tci.WithdrawalReflex(), duration=0.5)
    alone = standing()
    tci.run(alone, Waiting(lambda: None), duration=PERIODS * alone.period, write=False)
    assert not warmed


@pytest.mark.parametrize("name", ["nao", "icub", "g1"])
def test_a_warm_up_leaves_the_gate_and_its_commands_as_they_are(name: str) -> None:
    robot = tci.load_robot(name)
    body, position = GenericBody(robot), np.array(initial_position(robot))
    part = robot.parts[0]
    target = np.array(part.initial_posture) + 0.1

    def commands(*, warm: bool) -> list[bytes]:
        gate, sent = Gate(robot, period=0.01, stale_after=0.1), []
        warm_up = WarmUp(body, gate)
        for k in range(60):
            joints = JointReading(0.01 * k, k, position, np.zeros(len(position)))
            orders = [GenericCommand(part.name, Mode.POSITION, target)] if k == 20 else []
            safe = gate.step(body.to_platform(orders, joints)[0], joints, 0.01 * k)
            sent.append(safe.position.tobytes() + safe.velocity.tobytes())
            if warm:
                warm_up.step()
        assert gate.counts.steps == 60
        return sent

    assert commands(warm=True) == commands(warm=False)
