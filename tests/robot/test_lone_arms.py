"""The packaged arms that stand alone do what generic angles say, judged by MuJoCo on the maker's model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from helpers.mujoco_oracle import posed
from helpers.robot_groups import ARMS
from tci.body.retarget import retarget
from tci.gestures.gesture import record
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.xml import schema_path
from tci.robot.xml.extends import read_element

PLACES = {
    "franka": ("panda_link1", "panda_link4", "panda_link5"),
    "so101": ("shoulder_link", "lower_arm_link", "wrist_link"),
    "ur5": ("shoulder_link", "forearm_link", "wrist_1_link"),
}
"""Links that begin at the shoulder, the elbow and the wrist of each arm."""
REACH = {"franka": (0.316, 0.384), "so101": (0.116, 0.135), "ur5": (0.425, 0.392)}
"""Lengths [m] of upper arm and forearm, from data sheets and the makers' drawings."""
LACKING = {"franka": [], "so101": ["shoulder_yaw", "elbow_yaw"], "ur5": ["shoulder_yaw", "elbow_yaw"]}


@pytest.fixture(scope="module", params=ARMS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def places(robot: Robot, **moved: float) -> tuple[Array, Array]:
    """Places (3,) [m] of elbow and wrist at the initial posture, with `moved` [degrees] added to it."""
    part = robot.part("left_arm")
    more = np.deg2rad([moved.get(one.name, 0.0) for one in part.servos])
    data = posed(robot, part.name, part.initial_posture + more)
    base = data.body(robot.model.torso_link).xpos
    _, elbow, wrist = (data.body(name).xpos - base for name in PLACES[robot.name])
    return np.array(elbow), np.array(wrist)


def test_generic_joints_move_the_arm_as_a_person_expects(robot: Robot) -> None:
    """Initially the arm is raised, with its forearm forward. Roll raises it, pitch turns it to its inner
    side, the elbow lowers the forearm."""
    elbow, wrist = places(robot)
    assert elbow[2] > 0.0
    assert wrist[0] > elbow[0]
    inward, _ = places(robot, shoulder_pitch=10.0)
    assert inward[1] < elbow[1] - 1e-3
    assert inward[2] == pytest.approx(elbow[2], abs=1e-6)
    raised, _ = places(robot, shoulder_roll=-20.0)
    assert raised[2] < elbow[2] - 1e-2
    assert raised[0] > elbow[0] + 1e-2
    still, bent = places(robot, elbow_pitch=10.0)
    np.testing.assert_allclose(still, elbow, atol=1e-9)
    assert bent[2] < wrist[2] - 1e-3


def test_segments_are_as_long_as_the_data_sheet_says(robot: Robot) -> None:
    lengths = [segment.length for segment in robot.part("left_arm").segments]
    np.testing.assert_allclose(lengths, REACH[robot.name], atol=2e-3)


def test_what_an_arm_lacks_is_told_and_the_rest_is_inside_its_limits(robot: Robot) -> None:
    part, position = robot.part("left_arm"), initial_position(robot)
    assert [servo.name for servo in part.servos if servo.servo is None] == LACKING[robot.name]
    for servo in (robot.servos[one.servo] for one in part.servos if one.servo is not None):
        assert servo.limits.lower + 0.05 < position[servo.index] < servo.limits.upper - 0.05
        assert None not in servo.limits.model_dump(exclude={"assumed"}).values()


def test_the_schema_accepts_the_description(robot: Robot) -> None:
    etree.XMLSchema(etree.parse(str(schema_path()))).assertValid(read_element(Path(robot.source))[0])


def test_a_gesture_of_an_arm_is_that_of_its_own_shoulder(robot: Robot) -> None:
    """Gestures are relative to the torso frame. One that was recorded on the arm brings it where it was, also
    if its shoulder lacks a joint."""
    joints, chance = joint_map(robot, "left_arm"), np.random.default_rng(2)
    limits = [(robot.servos[one].limits.lower, robot.servos[one].limits.upper) for one in joints.servos]
    lower, upper = 0.9 * np.array(limits, dtype=float).T
    for _ in range(20):
        position = np.array(initial_position(robot))
        position[joints.servos] = chance.uniform(lower, upper)
        asked = record(robot, np.array([0.0, 1.0]), np.array([position, position])).postures["left_arm"][0]
        found = retarget(robot, "left_arm", asked, position)
        assert found.upper_arm_error < 1e-6
        turned = np.angle(np.exp(1j * (found.position - position)))
        np.testing.assert_allclose(turned, 0.0, atol=1e-6)
