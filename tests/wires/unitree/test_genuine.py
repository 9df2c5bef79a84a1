"""Programs with the vendor's own SDKs, in C++ and Python, as robots and as clients of TCI."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest

import tci
from helpers import HELPERS, TESTS
from helpers.dds_domains import DOMAINS
from helpers.patient import patient
from helpers.peers import peer_python
from tci.drivers.driver import Driver
from tci.errors import CommandError
from tci.gate.safe_command import GateState
from tci.wires.unitree.motors import NAMES

pytestmark = [pytest.mark.timeout(90), pytest.mark.xdist_group("unitree-domain-0")]
ELBOW = "left_elbow_joint"


class Peer:
    """A program of `sdk_peer`."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def told(self, *, robot: bool = False) -> dict[str, Any]:
        """Ends a robot program, or waits for the end of a client, and returns the printed results."""
        assert self.process.stdout is not None
        if robot:
            assert self.process.stdin is not None
            self.process.stdin.close()
        said = self.process.stdout.read()  # threads of the SDK print other text, even within a line
        found: dict[str, Any] = json.JSONDecoder().raw_decode(said, said.index('{"'))[0]
        return found


@contextmanager
def started(*command: str) -> Iterator[Peer]:
    """Runs a program and waits until the program prints `ready`."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, cwd=TESTS, **pipes) as process:
        assert process.stdout is not None
        try:
            while "ready" not in (line := process.stdout.readline()):
                assert line
            yield Peer(process)
        finally:
            process.kill()


def peer(role: str, domain: int) -> Any:
    return started(peer_python("unitree"), str(HELPERS / "sdk_peer.py"), role, str(domain))


def bend(driver: Driver, by: float, joint: str = ELBOW) -> None:
    """Moves a joint of the left arm. Repeats the order if the gate stops the motion on a busy machine."""
    arm = driver.native("left_arm")
    goal = arm.positions(driver.read().joints)[joint] + by
    for _ in range(20):
        orders = [arm.command({joint: goal})]
        for now in driver.ticks(duration=1.0):
            driver.write(driver.gate.step(orders, driver.read().joints, now))
            orders = []
        if abs(arm.positions(driver.read().joints)[joint] - goal) < 0.005:
            return
        if driver.gate.state is GateState.STOP:
            with suppress(CommandError):  # not at rest yet
                driver.gate.reset()


def test_a_robot_of_the_vendors_python_moves_its_arm_and_gets_it_back() -> None:
    domain = next(DOMAINS)
    with peer("py_robot", domain) as robot:
        with tci.connect(patient("g1"), f"unitree:lo/{domain}", arm=True) as driver:
            arm = driver.native("left_arm")
            assert arm.positions(driver.read().joints)[ELBOW] == pytest.approx(0.5)
            bend(driver, -0.35)
        found = robot.told(robot=True)
    assert found["wrong"] == 0
    assert found["smallest"] == pytest.approx(0.15, abs=0.01)
    assert found["largest_weight"] == 1.0
    assert found["weight"] == 0.0
    assert found["last"] == pytest.approx(0.5)


def test_a_robot_of_the_vendors_cpp_is_taken_by_name_and_left_damped() -> None:
    with peer("cpp_robot", 0) as robot:
        with tci.connect(patient("g1"), "unitree:lo?control=all", arm=True) as driver:
            bend(driver, 0.35)
        found = robot.told(robot=True)
    assert found["largest"] == pytest.approx(0.35, abs=0.01)
    assert found["stiffest"] == 40.0
    assert (found["stiffness"], found["damping"]) == (0.0, 2.0)


def test_fingers_of_the_vendors_python_bend_one_by_one_and_press_sensors_are_skin() -> None:
    domain, finger = next(DOMAINS), "left_hand_index_0_joint"
    with peer("py_hands", domain) as robot:
        with tci.connect(patient("g1-hands"), f"unitree:lo/{domain}", arm=True) as driver:
            hand = driver.native("left_arm")
            reading = driver.read()
            assert hand.positions(reading.joints)[finger] == pytest.approx(-0.1)
            palm = next(frame.values for frame in reading.skin if frame.patch == "left_palm")
            assert palm.tolist() == [1e5 + 10 * pad + one for pad in (6, 7, 8) for one in range(12)]
            bend(driver, -0.3, finger)
        found = robot.told(robot=True)
    assert found["left"] == pytest.approx([-0.1] * 5 + [-0.4, -0.1], abs=0.01), "no other finger of this hand"
    assert found["right"] == pytest.approx([0.1] * 7)
    assert [mode for mode, _, _ in found["first"][0]] == [0x90 | motor for motor in range(7)]
    assert found["first"][0][0][1] == pytest.approx(-0.1), "they start where they are"
    assert [kp for _, _, kp in found["last"][0]] == [0.0] * 7
    assert [mode for mode, _, _ in found["last"][0]] == [0x80 | motor for motor in range(7)]


def test_programs_of_the_vendor_move_a_served_robot() -> None:
    """The served robot is a NAO on the topics of a G1: two arms and a head."""
    with started(sys.executable, str(HELPERS / "patient.py"), "unitree:lo/0"):
        with peer("py_client", 0) as client:  # the client switches the robot's own controller off at its end
            found = client.told()
        assert found["before"] == [0, {"form": "0", "name": "ai"}]
        assert found["wrong"] == 0
        assert found["states"] > 100
        assert found["end"] - found["start"] == pytest.approx(0.3, abs=0.02)
        assert found["released"] == 0
        assert found["after"] == [0, {"form": "0", "name": ""}]
        with peer("cpp_client", 0) as client:
            found = client.told()
        assert found["variant"] == 5
        assert found["end"] - found["start"] == pytest.approx(-0.3, abs=0.02)


def test_all_motors_have_the_vendors_names() -> None:
    robot = tci.load_robot("g1")
    assert {servo.name for servo in robot.servos} == set(NAMES)
    assert len(np.unique([servo.index for servo in robot.servos])) == 29
