"""Arms with a retargeted shoulder move through the T-pose, where the generic angles are singular."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import Driven
from tci.body.posture import speed_limits, to_platform
from tci.body.retarget import angle_between
from tci.errors import CommandError
from tci.messages import GenericCommand, Mode
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.shoulder import shoulder_of

NAMES = ("g1", "talos", "alex")
T_POSE = np.deg2rad([0.0, 90.0, 0.0, 30.0, 0.0])
AWAY = np.deg2rad([40.0, 60.0, 0.0, 60.0, 0.0])


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", NAMES)
def test_an_arm_leaves_the_t_pose(name: str, side: str) -> None:
    robot, part = load_robot(name), f"{side}_arm"
    joints, shoulder = joint_map(robot, part), shoulder_of(robot, part)
    driven = Driven(robot, initial_position(robot))
    for target in (T_POSE, AWAY):
        command = GenericCommand(part, Mode.POSITION, target)
        for _ in range(5000):
            order = to_platform(robot, command, position=driven.angles)
            safe = driven.step(order)
            assert (safe.refusals, safe.reason) == ((), None)
            if np.abs(driven.angles[order.servos] - order.values).max() < 1e-8:
                break
        reached = shoulder.rotation(driven.angles[shoulder.servos])
        assert angle_between(reached, shoulder.wanted(target[:3], robot.part(part).R_TM)) < 1e-6
        np.testing.assert_allclose(joints.to_generic(driven.angles)[3:], target[3:], atol=1e-6)
        print(f"{name} {part}: {driven.time:.2f} s")
    np.testing.assert_allclose(joints.to_generic(driven.angles), AWAY, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("abduction", [80.0, 89.0, 89.99, 90.0])
def test_all_that_needs_no_generic_speed_is_understood_there(name: str, abduction: float) -> None:
    robot = load_robot(name)
    joints, position = joint_map(robot, "left_arm"), initial_position(robot).copy()
    posture = T_POSE.copy()
    posture[1] = np.deg2rad(abduction)
    position[joints.servos] = joints.to_robot(posture, position)
    for mode in (Mode.POSITION, Mode.IMPEDANCE):
        order = to_platform(robot, GenericCommand("left_arm", mode, AWAY), position=position)
        assert np.rad2deg(order.speed).tolist() == pytest.approx([180.0] * 5)
    assert np.rad2deg(speed_limits(robot, "left_arm", position)).tolist() == pytest.approx([180.0] * 5)
    for mode in (Mode.STIFFNESS, Mode.DAMPING):
        order = to_platform(robot, GenericCommand("left_arm", mode, np.full(5, 0.5)), position=position)
        assert order.values.tolist() == [0.5] * 5
        assert np.isinf(order.speed).all()


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.TORQUE])
def test_no_generic_velocity_or_torque_is_defined_there(mode: Mode) -> None:
    robot = load_robot("talos")
    joints, position = joint_map(robot, "left_arm"), initial_position(robot).copy()
    position[joints.servos] = joints.to_robot(T_POSE, position)
    with pytest.raises(CommandError, match="at 90 degrees of abduction no generic velocity"):
        to_platform(robot, GenericCommand("left_arm", mode, np.full(5, 0.1)), position=position)
