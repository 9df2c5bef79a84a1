"""Poses of the skin's links in one compiled loop are MuJoCo's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot.moving import random_postures
from tci.errors import UnknownNameError
from tci.robot.catalogue import load_robot, robot_names
from tci.robot.description import Model, Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import Kinematics
from tci.robot.link_poses import SkinLinks

ODD = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="base" pos="1 2 3" euler="0.1 0.2 0.3">
    <joint name="lift" type="slide" axis="1 0 1" ref="0.2"/>
    <body name="torso" pos="0 0 0.5"><joint name="loose" axis="0 1 0" ref="0.4"/>
      <body name="arm" pos="0.1 0 0" quat="1 2 3 4">
        <joint name="one" axis="1 1 0" pos="0.01 0.02 0.03" ref="0.7"/>
        <joint name="two" axis="0 0 1" pos="0.1 0 0"/>
        <body name="hand" pos="0 0.2 0"/>
      </body>
    </body>
    <body name="leg"><joint name="three" axis="0 1 0"/></body>
  </body>
</worldbody></mujoco>
"""


def assert_the_same(robot: Robot, postures: list[np.ndarray]) -> None:
    kinematics = Kinematics(robot)
    links = SkinLinks(robot, kinematics, kinematics.links)
    for posture in postures:
        found, expected = links.poses(posture), kinematics.poses(posture, kinematics.links)
        assert tuple(found) == tuple(expected)
        for link, pose in expected.items():
            np.testing.assert_allclose(found[link], pose, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", robot_names())
def test_poses_are_those_of_mujoco(name: str) -> None:
    robot = load_robot(name)
    assert_the_same(robot, list(random_postures(robot, 20)))


def test_sliding_joints_references_and_two_joints_on_a_link(tmp_path: Path) -> None:
    path = tmp_path / "odd.xml"
    path.write_text(ODD)
    nao = load_robot("nao")
    joints = ("lift", "one", "two", "three")
    moving = tuple(
        servo.model_copy(update={"joint": joint})
        for servo, joint in zip(nao.servos, (*joints, *[None] * len(nao.servos)), strict=False)
    )
    model = Model(
        format="mjcf", path=str(path), torso_link="torso", torso_rpy=(0.3, 0.0, 1.0), torso_xyz=(0.0, 0.1, 0)
    )
    robot = nao.model_copy(update={"model": model, "servos": moving})
    random = np.random.default_rng(0)
    assert_the_same(robot, [random.uniform(-2.0, 2.0, len(moving)) for _ in range(20)])


def test_an_unknown_link_is_named() -> None:
    robot = load_robot("nao")
    with pytest.raises(UnknownNameError, match="Paw"):
        SkinLinks(robot, Kinematics(robot), ["Paw"])
    links = SkinLinks(robot, Kinematics(robot), ["LForeArm"])
    with pytest.raises(KeyError):
        links.poses(np.array(initial_position(robot)))["Paw"]
