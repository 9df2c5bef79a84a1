"""The public stand-in for a robot: its gate is real, its joints and skin are what the test says."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.safe_command import GateState
from tci.messages import GenericCommand, Mode, MonotonicClock
from tci.testing import FakeDriver


class Bend(tci.Capability[None]):
    """Asks for one elbow angle [rad] in each period."""

    def __init__(self, angle: float) -> None:
        self.angle = angle

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[GenericCommand, ...], None]:
        goal = np.array(perception.posture["left_arm"])
        goal[3] = self.angle
        return (GenericCommand("left_arm", Mode.POSITION, goal),), None


def elbow(driver: FakeDriver) -> float:
    return driver.native("LArm").positions(driver.read().joints)["LElbowRoll"]


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_it_is_where_the_gate_lets_it_go_and_never_beyond(robot: str) -> None:
    driver = FakeDriver(robot)
    result = tci.run(driver, Bend(3.0), duration=3.0)
    assert result.accepted
    part = driver.robot.part("left_arm").servos[3]
    limits = driver.robot.servos[part.servo].limits
    assert driver.position[part.servo] == pytest.approx(
        limits.upper if driver.position[part.servo] > 0 else limits.lower, abs=0.01
    )
    path = [sent.position[sent.servos == part.servo] for sent in driver.sent]
    assert any(sent.clamped for sent in driver.sent)
    steps = np.diff(np.concatenate([one for one in path if one.size]))
    assert np.abs(steps).max() <= limits.velocity * driver.period * 1.001


def test_skin_is_felt_as_it_was_set() -> None:
    driver = FakeDriver("nao")
    assert not tci.run(driver, tci.WithdrawalReflex(), duration=0.1).touched
    values = np.full(240, 255.0 - driver.robot.patch("left_forearm").sensor.rest)
    driver.set_skin("left_forearm", values)
    assert tci.run(driver, tci.WithdrawalReflex(), duration=0.1).touched.keys() == {"left_forearm"}


def test_skin_of_another_size_and_unknown_patches_are_refused() -> None:
    driver = FakeDriver("nao")
    with pytest.raises(CommandError, match=r"left_forearm; valid: \(240,\)"):
        driver.set_skin("left_forearm", [1.0])
    with pytest.raises(UnknownNameError, match="left_forearm"):
        driver.set_skin("left_forarm", [1.0])


def test_a_robot_that_is_cut_off_is_held_and_comes_back() -> None:
    driver = FakeDriver("nao")
    driver.frozen = True
    driver.read()
    assert tci.run(driver, Bend(-0.5), duration=0.3).state is GateState.HOLD
    driver.frozen = False
    assert tci.run(driver, Bend(-0.5), duration=0.3).state is GateState.RUN


def test_a_fault_is_the_error_of_the_next_reading() -> None:
    driver = FakeDriver("nao")
    driver.fault = "the cable is out"
    with pytest.raises(DriverError, match="the cable is out"):
        driver.read()


def test_it_keeps_what_drivers_promise() -> None:
    driver = FakeDriver("nao", arm=False, rate=50.0, clock=MonotonicClock())
    assert driver.period == 0.02
    first, second = driver.read(), driver.read()
    assert second.joints.sequence == first.joints.sequence + 1
    assert second.joints.stamp >= first.joints.stamp
    assert {frame.patch for frame in first.skin} == {patch.name for patch in driver.robot.patches}
    safe = driver.gate.step([], first.joints, driver.clock.now())
    with pytest.raises(DriverError, match="arm=True"):
        driver.write(safe)
    other = FakeDriver("nao")
    with pytest.raises(DriverError, match="gate"):
        other.write(safe)
    other.halt()
    assert other.halts == 1
    with other:
        pass
    with pytest.raises(DriverError, match="closed"):
        other.read()
