"""A served robot: orders of other processes either pass the gate of the serving process or are refused."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from helpers.desk import Desk, turn_head
from tci.drivers.simulated import SimulatedDriver
from tci.messages import GenericCommand, ManualClock, Mode, MonotonicClock
from tci.reasons import Code, Reason
from tci.runtime.loop import Tick
from tci.runtime.serve import serve
from tci.runtime.watchdogs import PILED_UP


@pytest.fixture
def driver() -> SimulatedDriver:
    return SimulatedDriver(tci.load_robot("nao"))


def test_generic_orders_and_those_in_the_robots_joints_reach_it(driver: SimulatedDriver) -> None:
    own = driver.native("LArm").command({"LElbowRoll": -1.2})
    done = serve(Desk(driver, {1: [own, turn_head(0.3)]}), duration=1.5, clock=driver.clock)
    joints = driver.read().joints
    assert driver.native("LArm").positions(joints)["LElbowRoll"] == pytest.approx(-1.2, abs=0.01)
    assert tci.GenericBody(driver.robot).posture(joints)["head"][0] == pytest.approx(0.3, abs=0.01)
    assert (done.orders, sum(done.refusals.counts.values())) == (2, 0)


def test_what_does_not_fit_is_refused_with_a_reason_and_serving_goes_on(driver: SimulatedDriver) -> None:
    wrong = GenericCommand("head", Mode.POSITION, np.zeros(7))
    strange = GenericCommand("tail", Mode.POSITION, np.zeros(1))
    huge = driver.native("LArm").command({"LElbowRoll": float("nan")})
    desk = Desk(driver, {0: [wrong], 1: [wrong, strange], 2: [huge]})
    done = serve(desk, duration=0.5, clock=desk.driver.clock)
    assert [order for order, _ in desk.refused] == [wrong, wrong, strange]
    for (_, reason), word in zip(desk.refused, ("read", "7", "tail"), strict=True):
        assert word in reason.text
    assert "LElbowRoll" in desk.shown[2].refusals[0].text
    assert (done.orders, sum(done.refusals.counts.values())) == (4, 4)
    assert len(desk.shown) == round(0.5 / driver.period)


def test_a_server_that_misses_its_commander_holds_the_robot(driver: SimulatedDriver) -> None:
    desk = Desk(driver, {1: [turn_head(0.8)]})
    desk.reason = Reason(Code.COMMANDER_SILENT, "nobody commands")
    done = serve(desk, duration=0.5, clock=desk.driver.clock)
    assert (done.orders, desk.refused) == (1, [])
    assert {sent.state.value for sent in desk.shown} == {"hold"}
    assert abs(tci.GenericBody(driver.robot).posture(driver.read().joints)["head"][0]) < 0.01


def test_28_34_a_process_that_stood_still_holds_from_its_first_period_and_takes_nothing_old(
    driver: SimulatedDriver,
) -> None:
    own = driver.native("LArm")
    clock = ManualClock()
    elbow = own.positions(driver.read().joints)
    far, old = (own.command({"LElbowRoll": angle}, speed=0.5) for angle in (-1.4, -0.1))
    thaw = 200
    waiting = {thaw + later: [old] for later in (0, 1, 20)}
    desk = Desk(driver, {1: [far], **waiting})
    angles: list[float] = []

    def see(tick: Tick) -> None:
        angles.append(own.positions(tick.reading.joints)["LElbowRoll"])
        clock.advance(5.0 if len(angles) == thaw else driver.period)

    serve(desk, duration=2.0, observe=see, clock=clock)
    states = [sent.state.value for sent in desk.shown]
    held = round(PILED_UP / driver.period)
    assert set(states[:thaw]) == {"run"}
    assert set(states[thaw : thaw + held]) == {"hold"}
    assert set(states[thaw + held + 1 :]) == {"run"}
    assert "stood still for 5" in str(desk.shown[thaw].reason)
    for period in waiting:
        assert "stood still" in desk.shown[period].refusals[0].text
    at_thaw, rest = angles[thaw], angles[-1]
    assert elbow["LElbowRoll"] - at_thaw > 0.1, "it was on its way"
    assert at_thaw - rest < 0.02
    assert np.ptp(angles[thaw + 100 :]) < 1e-3


def test_a_period_that_is_late_on_a_busy_machine_is_no_standstill(driver: SimulatedDriver) -> None:
    clock = ManualClock()
    desk = Desk(driver, {1: [turn_head(0.3)]})
    serve(desk, duration=1.0, observe=lambda tick: clock.advance(0.29), clock=clock)
    assert {sent.state.value for sent in desk.shown} == {"run"}


def test_a_paced_simulation_is_not_ahead_of_real_time() -> None:
    clock = MonotonicClock()
    begin = clock.now()
    with SimulatedDriver(tci.load_robot("nao"), paced=True) as driver:
        start = driver.clock.now()
        for _ in driver.ticks(duration=0.2):
            assert driver.clock.now() - start <= clock.now() - begin + 1e-6


def test_55_an_unarmed_robot_is_shown_and_refuses_every_order() -> None:
    with SimulatedDriver(tci.load_robot("nao"), arm=False) as unarmed:
        before = unarmed.read().joints.position
        desk = Desk(unarmed, {5: [turn_head(0.3)]})
        done = serve(desk, duration=0.5, clock=desk.driver.clock)
        np.testing.assert_allclose(unarmed.read().joints.position, before, atol=1e-3)
    assert len(desk.shown) == round(0.5 / unarmed.period)
    assert "read-only" in desk.refused[0][1].text
    assert (done.orders, sum(done.refusals.counts.values())) == (1, 1)
