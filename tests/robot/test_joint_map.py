"""Transforms between servos and generic joints in both directions: tables, couplings and mixtures, and faults
in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tci.body.posture import to_platform
from tci.errors import DescriptionError
from tci.messages import GenericCommand, Mode
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.xml import read_robot

MIXED = """<?xml version="1.0"?>
<generic_robot version="1" name="mixed" angle_unit="deg">
  <robot_part name="waist">
    <servo id="0" name="left"/><servo id="1" name="right"/>
    <servo id="2" name="bent"/><servo id="3" name="plain"/>
  </robot_part>
  <generic_robot_part name="torso" kind="torso" robot_part="waist">
    <generic_servo id="0">
      <destination_servo_id>0</destination_servo_id>
      <transform_type>coupled</transform_type>
      <transform_displacement>10</transform_displacement>
      <coupled_term destination_servo_id="0" factor="0.5"/>
      <coupled_term destination_servo_id="1" factor="0.5"/>
    </generic_servo>
    <generic_servo id="1">
      <destination_servo_id>2</destination_servo_id>
      <transform_type>table</transform_type>
      <transform_table>
        <point robot="-90" generic="40"/>
        <point robot="0" generic="10"/>
        <point robot="45" generic="-80"/>
      </transform_table>
      <speed>30</speed>
    </generic_servo>
    <generic_servo id="2">
      <destination_servo_id>1</destination_servo_id>
      <transform_type>coupled</transform_type>
      <coupled_term destination_servo_id="0" factor="-0.5"/>
      <coupled_term destination_servo_id="1" factor="0.5"/>
    </generic_servo>
    <generic_servo id="3">
      <destination_servo_id>3</destination_servo_id>
      <transform_factor>-2</transform_factor>
    </generic_servo>
  </generic_robot_part>
</generic_robot>
"""


def load(folder: Path, text: str = MIXED) -> Robot:
    path = folder / "mixed.xml"
    path.write_text(text)
    return read_robot(path)


def test_generic_angles_by_hand(tmp_path: Path) -> None:
    robot = load(tmp_path)
    generic = joint_map(robot, "torso").to_generic(np.deg2rad([20.0, 40.0, 22.5, 5.0]))
    np.testing.assert_allclose(np.rad2deg(generic), [40.0, -35.0, 10.0, -10.0])


def test_tables_go_straight_on_beyond_their_ends(tmp_path: Path) -> None:
    robot = load(tmp_path)
    for angle, expected in ((-120.0, 50.0), (60.0, -110.0)):
        generic = joint_map(robot, "torso").to_generic(np.deg2rad([0.0, 0.0, angle, 0.0]))
        assert np.rad2deg(generic[1]) == pytest.approx(expected)


def test_position_velocity_and_torque_return_to_1e_12_with_equal_power(tmp_path: Path) -> None:
    robot = load(tmp_path)
    joints = joint_map(robot, "torso")
    random = np.random.default_rng(2)
    for _ in range(200):
        values, velocity, torque = random.uniform(-1.0, 1.0, (3, 4))
        command = to_platform(robot, GenericCommand("torso", Mode.POSITION, values))
        position = np.zeros(4)
        position[command.servos] = command.values
        np.testing.assert_allclose(joints.to_generic(position), values, rtol=0, atol=1e-12)
        v = to_platform(robot, GenericCommand("torso", Mode.VELOCITY, velocity), position=position)
        t = to_platform(robot, GenericCommand("torso", Mode.TORQUE, torque), position=position)
        slope = joints.slope(position)
        np.testing.assert_allclose((slope @ v.values)[np.argsort(joints.ids)], velocity, rtol=0, atol=1e-12)
        back = np.linalg.solve(slope.T, t.values)
        np.testing.assert_allclose(back[np.argsort(joints.ids)], torque, rtol=0, atol=1e-12)
        assert v.values @ t.values == pytest.approx(velocity @ torque, abs=1e-12)


def test_the_generic_speed_holds_through_a_table(tmp_path: Path) -> None:
    robot = load(tmp_path)
    for angle, expected in ((-45.0, 90.0), (30.0, 15.0)):
        position = np.deg2rad([0.0, 0.0, angle, 0.0])
        command = to_platform(robot, GenericCommand("torso", Mode.POSITION, np.zeros(4)), position=position)
        speeds = dict(zip(command.servos.tolist(), command.speed.tolist(), strict=True))
        assert np.rad2deg(speeds[2]) == pytest.approx(expected)


def test_the_generic_speed_holds_however_many_servos_turn_a_coupled_joint(tmp_path: Path) -> None:
    term = '<coupled_term destination_servo_id="0"'
    robot = load(tmp_path, MIXED.replace(term, f"<speed>10</speed> {term}"))
    joints = joint_map(robot, "torso")
    for mode in (Mode.POSITION, Mode.VELOCITY):
        command = to_platform(robot, GenericCommand("torso", mode, np.zeros(4)))
        speeds = dict(zip(command.servos.tolist(), command.speed.tolist(), strict=True))
        assert np.rad2deg([speeds[0], speeds[1]]).tolist() == pytest.approx([10.0, 10.0])
        for signs in np.array([[1, 1, 1, 1], [-1, 1, 1, 1]]):
            generic = joints.slope(np.zeros(4)) @ (
                np.where(np.isinf(command.speed), 0.0, command.speed) * signs
            )
            assert np.rad2deg(np.abs(generic[np.isin(joints.ids, [0, 2])])).max() <= 10.0 + 1e-9


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('robot="0" generic="10"', 'robot="-95" generic="10"', "must rise from point to point"),
        ('robot="0" generic="10"', 'robot="0" generic="60"', "must all rise or all fall"),
        ('<point robot="0" generic="10"/>\n        <point robot="45" generic="-80"/>', "", "of 1 points"),
        ("<speed>30</speed>", "<transform_factor>2</transform_factor>", "transform_factor is not for"),
        ("<transform_factor>-2</transform_factor>", '<coupled_term destination_servo_id="0" factor="1"/>',
         "coupled_term is for the transform_types coupled and synergy, not linear"),
        ('<coupled_term destination_servo_id="1"', '<coupled_term destination_servo_id="3"',
         "no coupled joint's destination_servo_id"),
        ('factor="-0.5"', 'factor="0.5"', "can't be told apart: singular matrix"),
        ('destination_servo_id="1" factor="0.5"', 'destination_servo_id="0" factor="0.5"', "already"),
        ("<transform_displacement>10</transform_displacement>", "<transform_factor>1</transform_factor>",
         "factors in its coupled_term elements only"),
        ("<transform_type>table</transform_type>", "<transform_type>retarget</transform_type>",
         "valid: 0, 1 and 2 of an arm"),
        ("<transform_type>table</transform_type>", "", "transform_table is for the transform_type table"),
    ],
)  # fmt: skip
def test_each_fault_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in MIXED
    with pytest.raises(DescriptionError) as caught:
        load(tmp_path, MIXED.replace(old, new, 1))
    assert words in str(caught.value)
    assert all(fault.line > 2 for fault in caught.value.faults)


@pytest.mark.parametrize("name", ["icub", "nao"])
def test_fingers_that_share_motors_bend_together(name: str) -> None:
    """An equal flexion of all fingers is reached exactly, with nine motors or one motor. If the motors can't
    reach a flexion, the error is minimal."""
    robot = load_robot(name)
    part, joints = robot.part("left_fingers"), joint_map(robot, "left_fingers")
    here = np.array(initial_position(robot))
    has = np.isin(np.arange(len(part.servos)), joints.ids)
    fist = np.where(has & (np.arange(10) % 2 == 1), np.deg2rad(50.0), joints.to_generic(here))
    here[joints.servos] = joints.to_robot(fist, here)
    np.testing.assert_allclose(joints.to_generic(here), fist, atol=1e-9)
    limits = [robot.servos[servo].limits for servo in joints.servos]
    lower, upper = np.array([(one.lower, one.upper) for one in limits]).T
    assert np.all((here[joints.servos] >= lower - 1e-9) & (here[joints.servos] <= upper + 1e-9))
    split = fist.copy()
    shared = (7, 9) if name == "icub" else (1, 3, 5)
    split[shared[0]] -= np.deg2rad(30.0)
    here[joints.servos] = joints.to_robot(split, here)
    mean = np.mean(split[list(shared)])
    np.testing.assert_allclose(joints.to_generic(here)[list(shared)], mean, atol=1e-9)


def test_velocity_torque_and_stiffness_of_fingers_reach_every_motor() -> None:
    robot = load_robot("icub")
    joints = joint_map(robot, "left_fingers")
    speed = np.zeros(10)
    speed[3] = 0.1
    sent = to_platform(robot, GenericCommand("left_fingers", Mode.VELOCITY, speed))
    moved = joints.slope(np.zeros(41)) @ sent.values
    np.testing.assert_allclose(moved, speed[joints.ids], atol=1e-9)
    assert np.count_nonzero(np.abs(sent.values) > 1e-9) == 2, "proximal and distal motor"
    shares = to_platform(robot, GenericCommand("left_fingers", Mode.STIFFNESS, np.full(10, 0.4)))
    np.testing.assert_allclose(shares.values, np.full(9, 0.4))
