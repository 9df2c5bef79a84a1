"""Inverse kinematics finds solutions within the limits for targets that forward kinematics can reach."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.moving import HANDS, coupled, random_postures, robot_and_kinematics
from tci.errors import CommandError, UnknownNameError
from tci.robot.description import Limits, Robot
from tci.robot.inverse import InverseKinematics
from tci.robot.joint_map import initial_position

COUNT = 200


def bounds(robot: Robot, servos: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    limits = [robot.servos[servo].limits for servo in servos]
    return np.array([limit.lower for limit in limits]), np.array([limit.upper for limit in limits])


def five(robot: Robot, link: str) -> list[int]:
    part = robot.part("left_arm" if link.lower().startswith("l") else "right_arm")
    return [servo.servo for servo in part.servos if servo.servo is not None]


@pytest.mark.parametrize("kind", ["five joints", "all joints", "pose"])
@pytest.mark.parametrize(("name", "link"), HANDS)
def test_what_can_be_reached_is_reached(name: str, link: str, kind: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    point = np.array([0.05, 0.0, 0.0])
    servos = five(robot, link) if kind == "five joints" else None
    inverse = InverseKinematics(robot, kinematics, link, point=point, servos=servos)
    lower, upper = bounds(robot, inverse.servos)
    others = np.setdiff1d(np.arange(len(robot.servos)), inverse.servos)
    reached = 0
    for random in random_postures(robot, COUNT, seed=3):
        posture = initial_position(robot).copy()
        posture[list(inverse.servos)] = random[list(inverse.servos)]
        T_TP, _ = kinematics.pose_and_jacobian(posture, link, point=point)
        answer = inverse.solve(T_TP if kind == "pose" else T_TP[:3, 3], initial_position(robot))
        moved = answer.position[list(inverse.servos)]
        assert (moved >= lower).all()
        assert (moved <= upper).all()
        assert coupled(robot, answer.position)
        assert np.array_equal(answer.position[others], initial_position(robot)[others])
        there, _ = kinematics.pose_and_jacobian(answer.position, link, point=point)
        assert np.linalg.norm(there[:3, 3] - T_TP[:3, 3]) == pytest.approx(answer.error, abs=1e-9)
        if answer.reached:
            assert answer.error <= 1e-5
            if kind == "pose":
                assert np.abs(there[:3, :3] - T_TP[:3, :3]).max() < 2e-4
        reached += answer.reached
    assert reached >= (0.97 if kind == "pose" else 0.99) * COUNT


@pytest.mark.parametrize(("name", "link"), HANDS)
def test_where_it_is_nothing_moves(name: str, link: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    inverse = InverseKinematics(robot, kinematics, link)
    for posture in random_postures(robot, 20):
        answer = inverse.solve(kinematics.poses(posture, [link])[link], posture)
        assert answer.reached
        assert answer.iterations == 0
        assert np.array_equal(answer.position, posture)


@pytest.mark.parametrize(("name", "link"), HANDS)
def test_a_small_motion_of_the_target_is_a_small_motion_of_the_arm(name: str, link: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    inverse = InverseKinematics(robot, kinematics, link)
    target = kinematics.poses(initial_position(robot), [link])[link][:3, 3]
    answer = inverse.solve(target + np.array([0.0, 0.0, 0.005]), initial_position(robot))
    assert answer.reached
    assert np.abs(answer.position - initial_position(robot)).max() < 0.2


@pytest.mark.parametrize("kind", ["position", "pose"])
@pytest.mark.parametrize(("name", "link"), HANDS)
def test_answers_are_near_the_present_posture(name: str, link: str, kind: str) -> None:
    """In nearly all cases the solution is at least as close to the present posture as the posture from which
    the target was computed."""
    robot, kinematics = robot_and_kinematics(name)
    inverse = InverseKinematics(robot, kinematics, link)
    chosen = list(inverse.servos)
    farther = 0
    for posture, present in random_postures(robot, 2 * COUNT, seed=4).reshape(COUNT, 2, -1):
        T_TL = kinematics.poses(posture, [link])[link]
        answer = inverse.solve(T_TL if kind == "pose" else T_TL[:3, 3], present)
        way = np.linalg.norm((answer.position - present)[chosen])
        farther += way > np.linalg.norm((posture - present)[chosen]) + 1e-3
    assert farther <= 0.06 * COUNT


def test_out_of_reach_is_an_answer_at_the_nearest_place() -> None:
    robot, kinematics = robot_and_kinematics("nao")
    inverse = InverseKinematics(robot, kinematics, "LHand")
    shoulder = np.array([0.0, 0.098, 0.1])
    answer = inverse.solve(shoulder + np.array([1.0, 0.0, 0.0]), initial_position(robot))
    assert not answer.reached
    # The length of the arm to the wrist is 161.6 mm: 105, 15 and 55.95 mm, with the elbow bent by 2 degrees.
    assert answer.error == pytest.approx(1.0 - 0.1616, abs=1e-3)


def test_what_is_wrong_is_named() -> None:
    robot, kinematics = robot_and_kinematics("nao")
    inverse = InverseKinematics(robot, kinematics, "LHand")
    with pytest.raises(CommandError, match=r"target of shape \(2,\)"):
        inverse.solve(np.zeros(2), initial_position(robot))
    with pytest.raises(CommandError, match="valid: finite"):
        inverse.solve(np.array([np.nan, 0, 0]), initial_position(robot))
    with pytest.raises(CommandError, match="no pose"):
        inverse.solve(np.zeros((4, 4)), initial_position(robot))
    with pytest.raises(CommandError, match="present posture"):
        inverse.solve(np.zeros(3), np.zeros(5))
    with pytest.raises(CommandError, match=r"some of \(2, 3, 4, 5, 6\)"):
        InverseKinematics(robot, kinematics, "LHand", servos=[2, 8])
    with pytest.raises(CommandError, match="each once"):
        InverseKinematics(robot, kinematics, "LHand", servos=[2, 2])
    with pytest.raises(CommandError, match="three finite"):
        InverseKinematics(robot, kinematics, "LHand", point=[0.0, 1.0])
    with pytest.raises(UnknownNameError, match="LPaw"):
        InverseKinematics(robot, kinematics, "LPaw")
    free = [s if s.index != 3 else s.model_copy(update={"limits": Limits()}) for s in robot.servos]
    with pytest.raises(CommandError, match=r"no limits of .*ShoulderRoll; "):
        InverseKinematics(robot.model_copy(update={"servos": tuple(free)}), kinematics, "LHand")
