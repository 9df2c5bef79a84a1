"""A robot without a binding to a middleware is served with the usual settings and names of this
middleware."""

from __future__ import annotations

import re
import threading
import time

import pytest

import tci
from helpers.wire_peers import wire
from tci.drivers.driver import Driver
from tci.drivers.registry import connect, open_server, server_names
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, UnknownNameError
from tci.lab.experiments.remote_trial import TrialDriver
from tci.robot.description import Address, Binding, Robot
from tci.runtime.serve import serve
from tci.wires.ros.names import Names
from tci.wires.yarp.driver import YarpDriver

OF_ONE_ROBOT = ("naoqi", "unitree")
"""Middleware that only one make of robots uses. It supports only robots with a binding to it."""


@pytest.mark.parametrize("name", tci.robot_names())
def test_every_robot_can_be_reached_by_every_middleware_that_carries_any_robot(name: str) -> None:
    robot = tci.load_robot(name)
    for middleware in set(server_names()) - set(OF_ONE_ROBOT):
        binding = robot.binding(middleware)
        assert binding.stale_after * binding.rate >= 1.0
        assert binding in robot.all_bindings


def test_a_middleware_of_one_robot_is_refused_for_others_with_those_that_are_valid() -> None:
    with pytest.raises(UnknownNameError, match=r"no binding of g1 named 'naoqi'; valid: .*sim, zenoh"):
        tci.load_robot("g1").binding("naoqi")


def test_an_own_binding_replaces_the_usual_one() -> None:
    own = Binding(middleware="ros2", rate=7.0, stale_after=0.3, addresses=(Address(of="torso", to="/waist"),))
    robot = tci.load_robot("g1").model_copy(update={"bindings": (own,)})
    assert robot.binding("ros2") == own
    assert robot.binding("ros1").rate == 100.0
    assert Names(robot, "ros2", "").command("torso") == "/waist"
    assert Names(robot, "ros1", "").command("torso") == "/torso_controller/joint_trajectory"
    assert {one.stale_after for one in robot.with_stale_after(0.5).all_bindings} == {0.5}


def oddly_named() -> Robot:
    """Returns a NAO with names that are valid in a description but in no middleware."""
    nao = tci.load_robot("nao").with_stale_after(0.5)
    servos = tuple(
        servo.model_copy(update={"robot_part": f"{servo.robot_part} / \N{GREEK SMALL LETTER ALPHA}"})
        for servo in nao.servos
    )
    patches = tuple(patch.model_copy(update={"name": f"1. {patch.name} (*)"}) for patch in nao.patches)
    own = {"name": "My robot #1", "servos": servos, "patches": patches}
    return nao.model_copy(update=own)


def drive(robot: Robot, name: str) -> Driver:
    """Serves a robot and moves its head over one middleware until joint data and frames of all patches have
    arrived.

    Returns the driver, which is closed.
    """
    with (
        wire(name) as via,
        TrialDriver(SimulatedDriver(robot, paced=True)) as own,
        open_server(own, via) as server,
    ):
        thread = threading.Thread(target=serve, args=(server,))
        thread.start()
        try:
            with connect(robot, server.reach(), arm=True) as driver:
                order = driver.native(robot.servos[0].robot_part).command({"HeadYaw": 0.2})
                end = time.monotonic() + 20.0
                for now in driver.ticks():
                    reading = driver.read()
                    driver.write(driver.gate.step([order], reading.joints, now))
                    felt = {frame.patch for frame in reading.skin if frame.sequence}
                    if reading.joints.position[0] > 0.15 and len(felt) == len(robot.patches):
                        return driver
                    assert time.monotonic() < end, f"{reading.joints.position[0]} rad, skin of {felt}"
        finally:
            own.until = 0.0
            thread.join()
    raise AssertionError("unreachable")


@pytest.mark.parametrize("name", ["zenoh", "lcm", "yarp", "player"])
def test_any_name_in_a_description_becomes_a_valid_one_on_the_wire(name: str) -> None:
    """Server and driver derive equal names, so joint data, all skin frames and commands are transmitted."""
    drive(oddly_named(), name)


def test_boards_have_the_names_of_the_binding_on_both_sides() -> None:
    robot = oddly_named()
    places = (Address(of=robot.servos[0].robot_part, to="neck"),)
    own = robot.binding("yarp").model_copy(update={"addresses": places})
    driver = drive(robot.model_copy(update={"bindings": (own,)}), "yarp")
    assert isinstance(driver, YarpDriver)
    assert [board.prefix for board in driver.boards.values()] == [
        "/My_robot__1/neck", "/My_robot__1/LArm____", "/My_robot__1/RArm____",
    ]  # fmt: skip


def test_names_in_ros_are_legal_and_each_belongs_to_one_place() -> None:
    robot = oddly_named()
    names = Names(robot, "ros2", "/here")
    topics = [names.command(part) for part in names.parts()]
    topics += [topic(patch.name) for patch in robot.patches for topic in (names.skin, names.frames)]
    assert len(set(topics)) == len(topics)
    for topic in topics:
        assert re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic), topic
    first, second, *others = robot.patches
    twins = (first, second.model_copy(update={"name": first.name.replace("(", "[")}), *others)
    with pytest.raises(DriverError, match="two patches of My robot #1 are called '/here/skin/_1__left"):
        Names(robot.model_copy(update={"patches": twins}), "ros2", "/here")
