"""Regression tests for the faults of the paper's Listing 1: each faulty command is refused or clamped, with a
message."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import Driven, make_robot, position_command
from tci.body.posture import to_platform
from tci.errors import CommandError
from tci.lab.experiments.same_stimulus import initial_joints
from tci.messages import GenericCommand, Mode
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericServo, Robot

NAO_RIGHT_POSE = (-1.10, 0.04)
"""Shoulder roll and elbow roll [rad] of the NAO in Listing 1: angles of a right arm, with the limits of a
left arm."""


@pytest.fixture(scope="module")
def nao() -> Robot:
    return load_robot("nao")


def index(robot: Robot, name: str) -> int:
    return next(servo.index for servo in robot.servos if servo.name == name)


@pytest.mark.parametrize(("side", "clamps"), [("R", 0), ("L", 2)])
def test_limits_of_the_other_arm(nao: Robot, side: str, clamps: int) -> None:
    driven = Driven(nao, initial_joints(nao).position)
    servos = [index(nao, f"{side}ShoulderRoll"), index(nao, f"{side}ElbowRoll")]
    safe = driven.step(position_command(servos, NAO_RIGHT_POSE))
    assert len(safe.clamped) == clamps
    driven.settle()
    driven.assert_within_limits()


def test_array_of_the_wrong_length() -> None:
    """In Listing 1, DOF is 16 on iCub, but the arrays of stiffness, damping, speed and MIN have 15
    entries."""
    with pytest.raises(CommandError, match=r"shape \(4,\); valid: \(5,\)"):
        to_platform(make_robot(), GenericCommand("left_arm", Mode.STIFFNESS, np.zeros(4)))


def test_the_clamped_value_is_the_one_that_is_sent() -> None:
    driven = Driven(make_robot(), [0.0] * 6)
    assert driven.step(position_command([2], [6.0])).clamped
    driven.settle()
    assert driven.angles[2] <= 2.0


def test_no_limit_is_read_past_the_end() -> None:
    """In Listing 1, `MIN[DOF]` read past the end of the array. Here a servo beyond the last one is
    refused."""
    safe = Driven(make_robot(), [0.0] * 6).step(position_command([6], [0.1]))
    assert "valid: 0 to 5" in safe.refusals[0].text


def test_speed_of_zero() -> None:
    safe = Driven(make_robot(), [0.0] * 6).step(position_command([2, 5], [0.1, 0.1], speed=0.0))
    assert "speed of joint2 is 0.0, joint5 is 0.0; valid: at least 0.001 rad/s" in safe.refusals[0].text
    assert safe.servos.size == 0


def test_a_servo_that_no_part_maps_is_never_sent() -> None:
    part = make_robot().parts[0]
    few = part.model_copy(update={"servos": (GenericServo(id=0, name="g", servo=3),)})
    robot = make_robot().model_copy(update={"parts": (few,)})
    driven = Driven(robot, [0.0] * 6)
    safe = driven.step(to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.array([0.5]))))
    assert safe.servos.tolist() == [3]
