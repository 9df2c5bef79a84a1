"""Jacobians equal difference quotients of the forward kinematics. Chains contain the correct servos."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.moving import ENDS, random_postures, robot_and_kinematics
from tci.errors import CommandError, UnknownNameError
from tci.messages.frames import apply
from tci.robot.joint_map import initial_position

STEP = 1e-5
POINT = np.array([0.02, -0.03, 0.05])


@pytest.mark.parametrize(("name", "link"), ENDS)
def test_a_jacobian_is_what_central_differences_give(name: str, link: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    for posture in random_postures(robot, 10):
        T_TP, jacobian = kinematics.pose_and_jacobian(posture, link, point=POINT)
        T_TL = kinematics.poses(posture, [link])[link]
        assert np.allclose(T_TP[:3, 3], apply(T_TL, POINT), rtol=0, atol=1e-12)
        assert np.allclose(T_TP[:3, :3], T_TL[:3, :3], rtol=0, atol=1e-12)
        for servo in range(len(robot.servos)):
            step = np.zeros(len(robot.servos))
            step[servo] = STEP
            ahead = kinematics.poses(posture + step, [link])[link]
            behind = kinematics.poses(posture - step, [link])[link]
            linear = (apply(ahead, POINT) - apply(behind, POINT)) / (2 * STEP)
            turn = (ahead - behind)[:3, :3] / (2 * STEP) @ T_TL[:3, :3].T
            angular = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
            assert np.allclose(jacobian[:, servo], [*linear, *angular], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("name", "link"), ENDS)
def test_only_the_servos_of_the_chain_move_a_link(name: str, link: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    chain = kinematics.chain(link)
    jacobian = kinematics.jacobian(random_postures(robot, 1)[0], link)
    assert np.flatnonzero(np.abs(jacobian[3:]).max(axis=0) > 1e-9).tolist() == sorted(chain)


def test_a_chain_runs_from_the_torso() -> None:
    robot, kinematics = robot_and_kinematics("icub")
    names = [robot.servos[servo].name for servo in kinematics.chain("l_hand")]
    assert names[0] == "l_shoulder_pitch"
    assert names[-1] == "l_wrist_yaw"
    assert len(names) == 7
    below = [robot.servos[servo].name for servo in kinematics.chain("root_link")]
    assert below == ["torso_yaw", "torso_roll", "torso_pitch"]
    assert kinematics.chain("chest") == ()


def test_what_is_wrong_is_named() -> None:
    robot, kinematics = robot_and_kinematics("nao")
    with pytest.raises(UnknownNameError, match="LPaw"):
        kinematics.jacobian(initial_position(robot), "LPaw")
    with pytest.raises(CommandError, match=r"\(3,\); the robot has 14"):
        kinematics.jacobian(np.zeros(3), "LHand")
    with pytest.raises(CommandError, match=r"point of shape \(2,\)"):
        kinematics.jacobian(initial_position(robot), "LHand", point=np.zeros(2))
