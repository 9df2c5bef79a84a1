"""Robots with joints over one driver and skin over another driver."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from helpers.served import Served
from helpers.still_nao import StillNao
from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.combined import CombinedDriver
from tci.drivers.driver import Driver
from tci.drivers.registry import connect
from tci.errors import DriverError
from tci.messages import Mode, Perception, PlatformCommand, PlatformOrder
from tci.robot.catalogue import load_robot
from tci.runtime.loop import Tick, run

ROBOT = load_robot("nao")
ELBOW = next(servo.index for servo in ROBOT.servos if servo.name == "LElbowRoll")


def wait_for(what: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)


class Bend(Capability[None]):
    """Moves an elbow slowly."""

    def init(self, body: GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[PlatformOrder, ...], None]:
        elbow = np.array([ELBOW])
        return (PlatformCommand(Mode.POSITION, elbow, np.array([-1.2]), np.array([0.3])),), None


def sequences(driver: Driver) -> dict[str, int]:
    return {frame.patch: frame.sequence for frame in driver.read().skin}


def test_joints_of_one_robot_and_the_skin_of_another_service() -> None:
    with StillNao() as body, StillNao(without=("ALMotion",)) as skin:
        body.board.measured[ELBOW] = -0.7
        with connect(ROBOT, f"{body.via} + {skin.via}", arm=True) as driver:
            wait_for(lambda: driver.read().joints.position[ELBOW] == pytest.approx(-0.7))
            body.touch("left_forearm", 5, np.zeros(240, np.uint8))
            skin.touch("left_forearm", 9, np.full(240, 100, np.uint8))
            wait_for(lambda: sequences(driver)["left_forearm"] == 9)
            order = driver.native("LArm").command({"LElbowRoll": -0.8})
            driver.write(driver.gate.step([order], driver.read().joints, driver.clock.now()))
            seen: list[Tick] = []
            run(driver, WithdrawalReflex(), duration=0.05, write=False, observe=seen.append)
            assert {frame.patch: frame.sequence for frame in seen[-1].reading.skin}["left_forearm"] == 9
            subjects = [finding.subject for finding in driver.diagnose()]
            assert subjects.count("NAOqi") == 2
            assert subjects.count("autonomy") == 1
        with pytest.raises(DriverError, match="closed"):
            driver.read()


@pytest.mark.timeout(300)
def test_joints_over_naoqi_and_skin_over_yarp() -> None:
    served = Served("nao", "yarp:127.0.0.1:0,dialect=3")
    try:
        with StillNao() as body:
            body.board.measured[ELBOW] = -0.7
            via = f"{body.via} + yarp:127.0.0.1:{served.port},dialect=3"
            with connect(ROBOT, via) as driver:
                assert isinstance(driver, CombinedDriver)
                assert driver.read().joints.position[ELBOW] == pytest.approx(-0.7)
                before = sequences(driver)
                assert before.keys() == {patch.name for patch in ROBOT.patches}
                wait_for(lambda: all(now > before[patch] for patch, now in sequences(driver).items()))
                assert {frame.values.shape for frame in driver.read().skin} == {(240,), (120,), (3,)}
    finally:
        served.kill()


def test_a_run_that_ends_in_motion_is_brought_to_rest() -> None:
    with StillNao() as body, StillNao(without=("ALMotion",)) as skin:
        body.board.measured[ELBOW] = -0.7
        with connect(ROBOT, f"{body.via} + {skin.via}", arm=True) as driver:
            wait_for(lambda: driver.read().joints.position[ELBOW] == pytest.approx(-0.7))

            def fail(tick: Tick) -> None:
                body.obey()
                if np.any(tick.sent.velocity):
                    raise RuntimeError("in motion")

            with pytest.raises(RuntimeError, match="in motion") as raised:
                run(driver, Bend(), observe=fail)
            assert not getattr(raised.value, "__notes__", [])


def test_what_can_not_be_joined_is_refused_and_what_was_open_is_closed() -> None:
    with StillNao() as body:
        with pytest.raises(DriverError, match="sim can't leave out its joints"):
            connect(ROBOT, f"{body.via} + sim")
        with pytest.raises(DriverError, match="sim can't leave out its skin"):
            connect(ROBOT, f"sim + {body.via}")
        with pytest.raises(DriverError, match="needs dialect=3 or dialect=4"):
            connect(ROBOT, f"{body.via} + yarp:127.0.0.1:{body.port}")
