"""Poses and Jacobians from the compiled loops equal MuJoCo's, and several threads may use one chain."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from helpers.moving import random_postures
from helpers.mujoco_oracle import Oracle
from tci.messages.frames import apply
from tci.robot.catalogue import load_robot, robot_names
from tci.robot.description import Model, Robot
from tci.robot.gravity import Gravity
from tci.robot.kinematics import KinematicChain

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
    kinematics, oracle, random = KinematicChain(robot), Oracle(robot), np.random.default_rng(4)
    for posture in postures:
        found, expected = kinematics.poses(posture, kinematics.links), oracle.poses(posture, kinematics.links)
        assert tuple(found) == tuple(expected)
        for link, pose in expected.items():
            np.testing.assert_allclose(found[link], pose, rtol=0, atol=1e-12)
        for link in random.choice(kinematics.links, min(len(kinematics.links), 12), replace=False).tolist():
            point = random.uniform(-0.1, 0.1, 3)
            T_TP, jacobian = kinematics.pose_and_jacobian(posture, link, point=point)
            np.testing.assert_allclose(jacobian, oracle.jacobian(posture, link, point), rtol=0, atol=1e-12)
            np.testing.assert_allclose(T_TP[:3, 3], apply(expected[link], point), rtol=0, atol=1e-12)
            np.testing.assert_allclose(T_TP[:3, :3], expected[link][:3, :3], rtol=0, atol=1e-12)


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


def test_threads_share_it() -> None:
    robot = load_robot("icub")
    kinematics = KinematicChain(robot)
    postures = list(random_postures(robot, 400))

    def work(posture: np.ndarray) -> tuple[bytes, bytes]:
        poses = kinematics.poses(posture, ("l_hand", "r_hand"))
        return np.array(list(poses.values())).tobytes(), kinematics.jacobian(posture, "l_hand").tobytes()

    alone = [work(posture) for posture in postures]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, postures)) == alone


def test_the_centre_of_mass_is_that_of_mujoco() -> None:
    for name in ("nao-whole", "icub-whole"):
        robot = load_robot(name)
        gravity, oracle = Gravity(robot), Oracle(robot)
        masses = gravity.masses
        for posture in random_postures(robot, 20):
            T_WT = oracle.move(posture)
            expected = np.linalg.inv(T_WT) @ np.append(masses @ oracle.data.xipos / masses.sum(), 1.0)
            np.testing.assert_allclose(gravity.centre_of_mass(posture), expected[:3], rtol=0, atol=1e-12)
