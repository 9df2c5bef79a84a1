"""Gravity torques equal the derivative of the potential energy, and agree with a case computed by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers import small_robot
from helpers.moving import random_postures, robot_and_kinematics
from tci.errors import CommandError, DescriptionError
from tci.robot.description import Robot
from tci.robot.gravity import STANDARD_GRAVITY, Gravity
from tci.robot.joint_map import initial_position
from tci.robot.model_file import load_spec


def weights(robot: Robot) -> list[tuple[str, float, np.ndarray]]:
    """Returns name, mass [kg] and centre of mass [m] of each body whose mass the model contains."""
    assert robot.model is not None
    spec = load_spec(robot.model)
    bodies = spec.bodies
    return [(body.name, body.mass, body.ipos.copy()) for body in bodies if body.explicitinertial]


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_torques_are_the_transposed_jacobians_times_the_weights(name: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    gravity = Gravity(robot)
    down = np.array([0.3, -0.2, -0.9])
    pull = down / np.linalg.norm(down) * STANDARD_GRAVITY
    assert robot.model is not None
    parts = [part for part in robot.parts if part.kind in ("arm", "head")]
    arms = [g.servo for part in parts for g in part.servos if g.servo is not None]
    for posture in random_postures(robot, 10):
        expected = np.zeros(len(robot.servos))
        for link, mass, centre in weights(robot):
            expected -= kinematics.jacobian(posture, link, point=centre)[:3].T @ (mass * pull)
        assert np.allclose(gravity.torques(posture, down=down)[arms], expected[arms], rtol=0, atol=1e-9)


def test_a_stretched_nao_arm_weighs_what_its_masses_say() -> None:
    """With arms forward, the torque is the sum over all links beyond the shoulder: weight times forward
    distance."""
    robot, kinematics = robot_and_kinematics("nao")
    held = Gravity(robot).torques(np.zeros(len(robot.servos)))
    moment = 0.0
    for link, mass, centre in weights(robot):
        if link in ("LShoulder", "LBicep", "LElbow", "LForeArm", "LHand", "LThumb", "LIndex", "LMiddle"):
            T_TL = kinematics.poses(np.zeros(len(robot.servos)), [link])[link]
            moment += mass * (T_TL[:3, :3] @ centre + T_TL[:3, 3])[0]
    pitch = next(s.index for s in robot.servos if s.joint == "LShoulderPitch")
    # Positive ShoulderPitch lowers the arm, so the torque that holds the arm has the opposite sign.
    assert held[pitch] == pytest.approx(-moment * STANDARD_GRAVITY, abs=1e-9)
    assert 0.1 < -held[pitch] < 1.0


def test_only_the_direction_of_down_counts() -> None:
    robot, _ = robot_and_kinematics("icub")
    gravity = Gravity(robot)
    standing = gravity.torques(initial_position(robot))
    assert np.allclose(standing, gravity.torques(initial_position(robot), down=np.array([0, 0, -7.0])))
    lying = gravity.torques(initial_position(robot), down=np.array([-1.0, 0, 0]))
    assert np.abs(standing - lying).max() > 0.1


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    robot, _ = robot_and_kinematics("nao")
    gravity = Gravity(robot)
    with pytest.raises(CommandError, match="the robot has 14 servos"):
        gravity.torques(np.zeros(3))
    for down in (np.zeros(3), np.zeros(2), np.array([np.nan, 0, 0])):
        with pytest.raises(CommandError, match="direction of gravity"):
            gravity.torques(initial_position(robot), down=down)
    small = small_robot.build(tmp_path)
    assert small.model is not None
    file = Path(small.model.path)
    file.write_text(file.read_text().replace("<geom ", "<geom mass='0' "))
    with pytest.raises(
        DescriptionError, match="l_0 moves and has no <inertial>; valid: an <inertial>, or geoms"
    ):
        Gravity(small)


MJCF = """
<mujoco><option><flag gravity="disable"/></option><worldbody>
  <body name="torso"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <body name="arm"><inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>
      <joint name="l0" axis="0 1 0"/><geom size="0.01"/>
      <body name="hand" pos="0 0 0.3"><geom size="0.05" mass="{mass}"/></body>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_weight_counts_whatever_a_simulation_of_the_model_leaves_out(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    robot = robot.model_copy(update={"servos": robot.servos[:1], "parts": (), "patches": ()})
    assert robot.model is not None
    Path(robot.model.path).write_text(MJCF.format(mass=0))
    assert Gravity(robot).torques(np.array([np.pi / 2]))[0] == pytest.approx(-0.1 * STANDARD_GRAVITY)
    Path(robot.model.path).write_text(MJCF.format(mass=2))
    held = Gravity(robot).torques(np.array([np.pi / 2]))[0]
    assert held == pytest.approx(-(0.1 + 2 * 0.3) * STANDARD_GRAVITY)
