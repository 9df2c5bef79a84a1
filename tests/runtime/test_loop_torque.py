"""The end of a run in torque mode: the last torque that is sent is zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.gate.gate import GateState, SafeCommand
from tci.messages import Mode, Perception, PlatformCommand, PlatformOrder, PlatformSwitch, Reading
from tci.messages.frames import read_only
from tci.runtime.control import REST
from tci.runtime.loop import Tick, run
from tci.simulation.world import World

ROBOT = tci.load_robot("icub")
ELBOW = next(servo.index for servo in ROBOT.servos if servo.name == "l_elbow")
END = 0.05
"""Time [s] after the last reading within which torques end."""


class Push(tci.Capability[None]):
    """Sends a torque to one joint until the gate brakes the joint, and longer."""

    def init(self, body: GenericBody) -> None:
        return None

    def begin(self, perception: Perception, body: GenericBody) -> tuple[PlatformOrder, ...]:
        return (PlatformSwitch(np.array([ELBOW]), Mode.TORQUE),)

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[PlatformOrder, ...], None]:
        return (PlatformCommand(Mode.TORQUE, np.array([ELBOW]), np.array([2.0]), np.ones(1)),), None


class Sent(list[tuple[float, float]]):
    """Times [s] and torques [N m] that were sent to the elbow."""

    def __init__(self, driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch) -> None:
        write = driver.write

        def noted(safe: SafeCommand) -> SafeCommand:
            place = safe.servos.tolist().index(ELBOW)
            self.append((safe.stamp, float(safe.torque[place])))
            return write(safe)

        monkeypatch.setattr(driver, "write", noted)

    def since(self, time: float) -> np.ndarray:
        """Returns the torques that were sent from `time` [s] on."""
        return np.array([torque for stamp, torque in self if stamp >= time - 1e-9])


@pytest.fixture(scope="module")
def world() -> World:
    return World(ROBOT)


@pytest.fixture
def driver(world: World) -> SimulatedDriver:
    world.reset()
    return SimulatedDriver(world.robot, world=world)


def test_28_reading_that_fails_where_writing_works_ends_with_no_torque(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent, lost = Sent(driver, monkeypatch), []

    def cut() -> Reading:
        lost.append(driver.clock.now())
        raise DriverError("reading fails, on purpose")

    def observe(tick: Tick) -> None:
        braked = bool(sent) and sent[-1][1] < -0.2
        if braked:  # the gate brakes against the commanded torque
            monkeypatch.setattr(driver, "_receive", cut)

    with pytest.raises(DriverError, match="on purpose"):
        run(driver, Push(), duration=5.0, observe=observe)
    begun = lost[0] - driver.period
    assert sent.since(begun)[0] < -0.2
    assert not sent.since(begun + END).any()
    assert sent[-1][1] == 0.0


def test_joint_data_that_keeps_a_torque_up_does_not_outlive_the_run(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A joint that keeps moving back and forth is braked, and its torque is zero before the loop ends."""
    sent, receive = Sent(driver, monkeypatch), driver._receive

    home = read_only(driver.world.joints().position.copy())

    def restless() -> Reading:
        joints = receive().joints
        angle, speed = -0.0125 * np.cos(40.0 * joints.stamp), 0.5 * np.sin(40.0 * joints.stamp)
        velocity = read_only(np.full(len(ROBOT.servos), speed))
        return Reading(replace(joints, position=read_only(home + angle), velocity=velocity), ())

    monkeypatch.setattr(driver, "_receive", restless)
    run(driver, Push(), duration=0.2)
    assert np.abs(sent.since(0.2)).max() > 2.0, "it is braked"
    assert len(sent.since(0.2)) <= REST / driver.period
    assert sent[-1][1] == 0.0
    assert driver.gate.state is not GateState.STOP


@pytest.mark.parametrize("failures", [2, 1000], ids=["for a moment", "for good"])
def test_writing_that_fails_does_not_end_the_way_to_rest(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch, failures: int
) -> None:
    """One of several boards refuses a command. The other boards must still receive the end of the torques."""
    sent, send, failed = Sent(driver, monkeypatch), driver._send, []

    def refuse(safe: SafeCommand) -> None:
        send(safe)
        if failed or sent[-1][1] < -0.2:  # the gate brakes against the commanded torque
            failed.append(safe.stamp)
        if 0 < len(failed) <= failures:
            raise DriverError("writing fails, on purpose")

    monkeypatch.setattr(driver, "_send", refuse)
    with pytest.raises(DriverError, match="on purpose") as raised:
        run(driver, Push(), duration=5.0)
    assert sent.since(failed[0])[0] < -0.2
    assert sent[-1][1] == 0.0
    notes = "".join(getattr(raised.value, "__notes__", ()))
    assert ("could not be brought to rest" in notes) == (failures > 2)
