"""Faults in the complete pipeline: the simulated robot moves, an injector changes its data, the gate and the
loop react.

The names of the tests contain the number of the fault in the catalogue.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

import tci
from helpers.rehearsal import AT, Rehearsal
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultPlan, parse_fault
from tci.lab.faults.injectors import INJECTORS
from tci.reasons import Code
from tci.simulation.world import World


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"))


@pytest.fixture
def driver(world: World) -> SimulatedDriver:
    world.reset()
    world.set_power(np.arange(len(world.robot.servos)), on=True)
    return SimulatedDriver(world.robot, world=world)


def test_04_nan_taxel(driver: SimulatedDriver) -> None:
    done = Rehearsal(driver, "nan-taxel")
    assert done.states == {GateState.RUN}
    assert not any(tick.perception.contacts for tick in done.ticks)


def test_04_nan_angle(driver: SimulatedDriver) -> None:
    done = Rehearsal(driver, "nan-angle", lasts=0.1)
    assert done.states == {GateState.RUN, GateState.HOLD}
    assert done.ticks[-1].sent.state is GateState.RUN
    assert all(np.isfinite(tick.sent.position).all() for tick in done.ticks)


def test_10_dropped_frames(driver: SimulatedDriver) -> None:
    done = Rehearsal(driver, "dropped-frames", lasts=0.2)
    held = [tick.now for tick in done.ticks if tick.sent.state is GateState.HOLD]
    assert held[0] - AT <= driver.gate.stale_after + 2 * driver.period
    assert done.ticks[-1].sent.state is GateState.RUN
    assert GateState.STOP not in done.states


def no_effect(driver: SimulatedDriver, name: str) -> None:
    assert Rehearsal(driver, name, lasts=0.3).states == {GateState.RUN}


def test_11_out_of_order(driver: SimulatedDriver) -> None:
    no_effect(driver, "out-of-order")


def test_12_duplicates(driver: SimulatedDriver) -> None:
    no_effect(driver, "duplicates")


def test_13_clock_jump(driver: SimulatedDriver) -> None:
    before = time.time
    no_effect(driver, "clock-jump")
    assert time.time is before


def test_14_frozen_source(driver: SimulatedDriver) -> None:
    assert Rehearsal(driver, "frozen-source").stopped_after() < 0.15


def rejected(driver: SimulatedDriver, name: str) -> None:
    done = Rehearsal(driver, name)
    assert 0.09 < done.stopped_after() < 0.15
    assert done.report.rejected == sum(tick.now >= AT - 1e-9 for tick in done.ticks)


def test_15_wrong_taxel_count(driver: SimulatedDriver) -> None:
    rejected(driver, "wrong-taxel-count")
    driver.world.reset()
    short = Rehearsal(SimulatedDriver(driver.robot, world=driver.world), "wrong-taxel-count", lasts=0.05)
    assert short.report.rejected > 0
    assert short.states == {GateState.RUN}


def test_35_wrong_type(driver: SimulatedDriver) -> None:
    rejected(driver, "wrong-type")


def test_19_wrong_direction(driver: SimulatedDriver) -> None:
    assert Rehearsal(driver, "wrong-direction").stopped_after() < 0.3


def test_20_stale_encoder(driver: SimulatedDriver) -> None:
    assert Rehearsal(driver, "stale-encoder").stopped_after() < 0.3


def test_21_stall(driver: SimulatedDriver) -> None:
    """A joint that is held is a contact: the part goes back, and the reference stays near the joint."""
    done = Rehearsal(driver, "stall")
    told = [tick.now - AT for tick in done.ticks for one in tick.sent.clamped if one.code is Code.CONTACT]
    assert told
    assert told[0] < 0.3
    last = done.ticks[-1]
    error = np.abs(last.sent.position - last.reading.joints.position[last.sent.servos])
    assert error.max() < np.deg2rad(6.0)


def test_22_servo_off(driver: SimulatedDriver) -> None:
    assert Rehearsal(driver, "servo-off").stopped_after() < 0.01


def test_23_mode_mismatch(driver: SimulatedDriver) -> None:
    assert 0.45 < Rehearsal(driver, "mode-mismatch").stopped_after() < 0.55


def test_25_encoder_step(driver: SimulatedDriver) -> None:
    assert Rehearsal(driver, "encoder-step").stopped_after() < 0.01


def test_41_overrun(driver: SimulatedDriver) -> None:
    done = Rehearsal(driver, "overrun")
    assert done.report.overruns == 1
    assert done.report.missed >= 3
    assert done.states == {GateState.RUN, GateState.HOLD}
    assert done.ticks[-1].sent.state is GateState.RUN


def test_42_sigterm(driver: SimulatedDriver) -> None:
    with pytest.raises(SystemExit) as ended:
        Rehearsal(driver, "sigterm")
    assert ended.value.code == 143
    assert driver.gate.state is GateState.STOP
    assert driver.world.time < AT + 0.5


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_45_thread_fails(driver: SimulatedDriver) -> None:
    with pytest.raises(RuntimeError, match="on purpose"):
        Rehearsal(driver, "thread-fails")
    assert driver.gate.state is GateState.STOP


def test_28_driver_lost(driver: SimulatedDriver) -> None:
    with pytest.raises(DriverError, match="lost"):
        Rehearsal(driver, "link-lost")
    assert driver.gate.state is GateState.STOP
    driver.world.advance(driver.world.time + 0.05)
    assert np.abs(driver.world.joints().velocity).max() < 0.02


@pytest.mark.parametrize("name", ["taxel-stuck-high", "taxel-stuck-low", "dead-patch", "saturated-taxel"])
def test_injectors_of_open_faults_do_what_they_say(driver: SimulatedDriver, name: str) -> None:
    patch = driver.robot.patches[0]
    sound = driver.read()
    spoilt = INJECTORS[name](driver, sound).read(sound).skin
    values = {"taxel-stuck-low": patch.sensor.rest, "dead-patch": 0.0}
    pressed = patch.sensor.lowest if patch.sensor.pascal_per_count < 0 else patch.sensor.highest
    assert spoilt[0].patch == patch.name
    assert spoilt[0].values[0] == values.get(name, pressed)
    assert spoilt[1] is sound.skin[1]


@pytest.mark.parametrize("text", ["stall", "stall@", "stall@-1", "stall@nan", "stall@1:0"])
def test_a_plan_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(CommandError, match="valid"):
        parse_fault(text)


def test_a_fault_that_there_is_not_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"no fault named 'stal' \(did you mean 'stall'\?\); valid: "):
        parse_fault("stal@1")


def test_a_plan_is_read() -> None:
    assert parse_fault("stall@0.5:2") == FaultPlan("stall", 0.5, 2.0)
