"""Posture transforms (eqs 1-2) in both directions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.gate_checks import make_robot, reading
from tci.body.posture import home, to_platform
from tci.errors import CommandError, FrameError, UnknownNameError
from tci.messages import GenericCommand, Mode
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericPart, GenericServo, Robot
from tci.robot.joint_map import generic_posture, joint_map

GAMMA = st.floats(1e-3, 1e3).flatmap(lambda size: st.sampled_from([size, -size]))
ANGLE = st.floats(-3.2, 3.2)


def with_servos(*servos: GenericServo) -> Robot:
    part = GenericPart(name="left_arm", kind="arm", side="left", servos=servos)
    return make_robot().model_copy(update={"parts": (part,)})


@given(st.lists(st.tuples(GAMMA, ANGLE, ANGLE), min_size=5, max_size=5))
def test_generic_to_platform_to_generic_returns(rows: list[tuple[float, float, float]]) -> None:
    robot = with_servos(
        *(
            GenericServo(id=i, name=f"g{i}", servo=5 - i, scale=g, offset=o)
            for i, (g, o, _) in enumerate(rows)
        )
    )
    values = np.array([value for _, _, value in rows])
    command = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, values))
    position = np.zeros(6)
    position[command.servos] = command.values
    np.testing.assert_allclose(joint_map(robot, "left_arm").to_generic(position), values, rtol=0, atol=1e-12)


@given(st.lists(st.tuples(GAMMA, ANGLE, ANGLE), min_size=3, max_size=3))
def test_power_is_the_same_on_both_sides(rows: list[tuple[float, float, float]]) -> None:
    robot = with_servos(
        *(GenericServo(id=i, name=f"g{i}", servo=i, scale=g) for i, (g, _, _) in enumerate(rows))
    )
    torque, velocity = (np.array([row[k] for row in rows]) for k in (1, 2))
    there = [
        to_platform(robot, GenericCommand("left_arm", mode, values)).values
        for mode, values in ((Mode.TORQUE, torque), (Mode.VELOCITY, velocity))
    ]
    assert there[0] @ there[1] == pytest.approx(torque @ velocity, rel=1e-12, abs=1e-12)


def test_only_mapped_servos_are_named() -> None:
    command = to_platform(make_robot(), GenericCommand("left_arm", Mode.POSITION, np.zeros(5)))
    assert command.servos.tolist() == [0, 1, 2, 3, 4]


def test_a_joint_that_the_robot_lacks_reads_as_fixed_and_is_dropped() -> None:
    robot = with_servos(
        GenericServo(id=0, name="shoulder_pitch", servo=3),
        GenericServo(id=1, name="elbow_yaw", servo=None, fixed=0.4),
    )
    posture = generic_posture(robot, reading([0, 0, 0, 0.7, 0, 0]))
    np.testing.assert_array_equal(posture["left_arm"], [0.7, 0.4])
    command = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.array([0.1, 2.0])))
    assert command.servos.tolist() == [3]


@pytest.mark.parametrize("mode", [Mode.STIFFNESS, Mode.DAMPING])
def test_shares_are_not_scaled(mode: Mode) -> None:
    robot = with_servos(GenericServo(id=0, name="g", servo=0, scale=-4.0, offset=1.0))
    assert to_platform(robot, GenericCommand("left_arm", mode, np.array([0.5]))).values.tolist() == [0.5]


def test_home_is_made_of_commands_like_any_other() -> None:
    robot = make_robot()
    commands = home(robot.part("left_arm"))
    assert [command.mode for command in commands] == [Mode.STIFFNESS, Mode.DAMPING, Mode.POSITION]
    assert all(to_platform(robot, command).servos.size == 5 for command in commands)


def test_faults_name_part_place_and_what_is_valid() -> None:
    robot = make_robot()
    with pytest.raises(CommandError, match=r"left_arm: values of shape \(4,\); valid: \(5,\)"):
        to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.zeros(4)))
    with pytest.raises(CommandError, match="g2 = nan"):
        to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.array([0, 0, np.nan, 0, 0])))
    with pytest.raises(UnknownNameError, match="left_arm"):
        to_platform(robot, GenericCommand("tail", Mode.POSITION, np.zeros(5)))
    with pytest.raises(FrameError, match="6 servos"):
        generic_posture(robot, reading([0.0] * 4))


def test_a_part_without_any_joint_is_refused() -> None:
    """A NAO has no joint in its torso."""
    nao = load_robot("nao")
    with pytest.raises(
        CommandError, match="nao has no joint in its torso: it lacks pitch, roll, yaw; valid: "
    ):
        to_platform(nao, GenericCommand("torso", Mode.POSITION, np.zeros(3)))
