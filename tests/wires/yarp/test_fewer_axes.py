"""Boards with fewer axes than the description, like the boards of the iCub in Gazebo: arms with 7 axes, a
head with 3."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import cast

import numpy as np
import pytest

import tci
import tci.lab
from helpers.patient import patient
from helpers.yarp_show import Show, until
from tci.drivers.diagnosis import Level
from tci.errors import DriverError, UnknownNameError
from tci.gate.gate import GateState
from tci.messages import GenericCommand, Mode, Order
from tci.reasons import Code
from tci.robot.description import Robot, Servo
from tci.wires.yarp import server
from tci.wires.yarp.axes import find_axes
from tci.wires.yarp.driver import YarpDriver
from tci.wires.yarp.served_board import ServedBoard
from yarpwire.board import Board
from yarpwire.dialect import V3

AXES = {"left_arm": 7, "right_arm": 7, "head": 3, "torso": 3}


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Show]:
    """Yields a served iCub whose boards have the same axes as the iCub in Gazebo."""

    def board(part: str, servos: Sequence[Servo]) -> ServedBoard:
        return ServedBoard(part, servos[: AXES[part]])

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
        patch.setattr(server, "ServedBoard", board)
        running = Show(V3, "icub")
        yield running
        running.close()


def where(show: Show, options: str = "") -> str:
    return "{}:{}".format(*show.names.address) + options


def test_it_connects_and_moves_the_arms_and_fingers_are_refused_by_name(show: Show) -> None:
    robot = patient("icub")
    with YarpDriver(robot, where(show), arm=True) as driver:
        assert {part: len(board.axes.names) for part, board in driver.boards.items()} == AXES
        reading = driver.read().joints
        fingers = [servo.index for servo in robot.servos if not servo.joints]
        assert len(fingers) == 2 * 9 + 3
        assert np.isfinite(reading.position).all()
        assert reading.powered is not None
        assert np.flatnonzero(~reading.powered).tolist() == fingers
        body = tci.GenericBody(driver.robot)

        def order(part: str, servo: int, angle: float) -> list[GenericCommand]:
            values = tci.Perceiver(body).step(driver.read(), driver.clock.now()).posture[part].copy()
            values[servo] += angle
            return [GenericCommand(part, Mode.POSITION, values)]

        elbow = robot.part("left_arm").servos[3].servo
        assert elbow is not None
        start = driver.read().joints.position[elbow]
        bend = order("left_arm", 3, 0.1)

        def moved() -> bool:
            pending, _ = body.to_platform(bend, driver.read().joints)
            sent = driver.write(driver.gate.step(pending, driver.read().joints, driver.clock.now()))
            return sent.state is GateState.RUN and abs(driver.read().joints.position[elbow] - start) > 0.05

        assert until(moved)
        grip, _ = body.to_platform(order("left_fingers", 3, 0.1), driver.read().joints)
        sent = driver.write(driver.gate.step(grip, driver.read().joints, driver.clock.now()))
        (refusal,) = sent.refusals
        assert refusal.code is Code.ROBOT_REFUSES
        assert "/icub/left_arm has no axis for it" in refusal.text
        assert sent.state is not GateState.STOP


def test_doctor_judges_as_the_driver_does(show: Show) -> None:
    robot = patient("icub")
    probed = YarpDriver.probe(robot, where(show))
    with YarpDriver(robot, where(show)) as driver:
        found = driver.diagnose()
        judged = tci.lab.judge(driver, tci.lab.observe(driver, 0.3))
        assert not any("switch them on" in finding.advice for finding in judged)
    for findings in (probed, found):
        assert {finding.level for finding in findings} <= {Level.OK, Level.NOTE}
        notes = {finding.subject: finding.what for finding in findings if finding.level is Level.NOTE}
        assert notes.keys() == {"left_arm", "right_arm", "head"}
        assert "no axis of eyes_tilt, eyes_version, eyes_vergence" in notes["head"]


def test_a_board_without_a_joint_of_the_model_is_refused_by_both(show: Show) -> None:
    def longer(robot: Robot) -> Robot:
        """Returns a robot for which the fourth finger motor of the left arm is a joint of the model."""
        servos = [
            servo.model_copy(update={"joint": "l_elbow"}) if servo.name == "l_pinky" else servo
            for servo in robot.servos
        ]
        return robot.model_copy(update={"servos": tuple(servos)})

    robot = longer(patient("icub"))
    with pytest.raises(DriverError, match="the description has also l_pinky"):
        YarpDriver(robot, where(show))
    faults = [f for f in YarpDriver.probe(robot, where(show)) if f.level is Level.FAULT]
    assert [(fault.subject, "l_pinky" in fault.what) for fault in faults] == [("left_arm", True)]


def test_fingers_are_not_given_to_axes_with_other_names() -> None:
    """A board with eight axes has the axis of a tool in addition to the arm. No finger servo is mapped to
    this axis."""
    servos = patient("icub").servos_of("left_arm")
    names = [*(servo.name for servo in servos[:7]), "l_extra_tool"]
    found = find_axes(cast(Board, Named(names)), servos)
    assert [servo.name for servo in found.servos] == names[:7]
    assert found.numbers == tuple(range(7))
    other = find_axes(cast(Board, Named([f"j{number}" for number in range(8)])), servos)  # by number alone
    assert other.numbers == tuple(range(8))


class Named:
    """A board that only returns the names of its axes."""

    prefix = "/icub/left_arm"

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names

    def axes(self) -> int:
        return len(self.names)

    def name(self, axis: int) -> str:
        return self.names[axis]


def test_doctor_honours_without_and_an_unknown_patch_is_an_error(show: Show) -> None:
    robot = patient("icub")
    first = robot.patches[0]
    moved = robot.model_copy(
        update={"patches": (first.model_copy(update={"name": "elsewhere"}), *robot.patches[1:])}
    )
    faults = [f.subject for f in YarpDriver.probe(moved, where(show)) if f.level is Level.FAULT]
    assert faults == ["elsewhere"]
    left = YarpDriver.probe(moved, where(show, ",without=elsewhere"))
    assert Level.FAULT not in {finding.level for finding in left}
    with pytest.raises(UnknownNameError, match="elsewhere"):
        YarpDriver(robot, where(show, ",without=elsewhere"))
    assert "elsewhere" in YarpDriver.probe(robot, where(show, ",without=elsewhere"))[-1].what


def test_a_board_that_comes_back_with_other_axes_is_not_commanded(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, take = "left_arm", show.server.orders
    servos, usual = show.driver.robot.servos_of(part), show.server.boards[part]
    work: list[ServedBoard] = []

    def orders() -> Sequence[Order]:
        while work:
            show.server.close_board(part)
            show.server.boards[part] = work.pop()
            show.server.open_board(part)
        return take()

    monkeypatch.setattr(show.server, "orders", orders)
    with YarpDriver(patient("icub"), where(show), arm=True) as driver:
        arm = driver.native(part)
        start = driver.read().joints.position[servos[0].index]

        def step() -> GateState:
            order = arm.command({servos[0].name: start})
            sent = driver.write(driver.gate.step([order], driver.read().joints, driver.clock.now()))
            time.sleep(driver.period)
            return sent.state

        assert until(lambda: step() is GateState.RUN)
        for other in ((servos[1], servos[0], *servos[2:7]), servos[:8]):
            work.append(ServedBoard(part, other))
            assert until(lambda: step() is GateState.HOLD)
            end = time.monotonic() + 2.0
            while time.monotonic() < end:
                assert step() is GateState.HOLD
            feed = driver.boards[part].feed
            assert feed is not None
            assert "came back with the axes" in feed.last_error
        work.append(usual)
        assert until(lambda: step() is GateState.RUN)
