"""Identification of joint friction by two slow sweeps, on a simulated arm with wrong masses and over the
simulated driver."""

from __future__ import annotations

from pathlib import Path

import pytest

import tci
from helpers.bare_body import bare_body
from helpers.pushed_arm import COULOMB, PERIOD, VISCOUS, Plant
from tci.cli.hardware import Simulation, check_hardware
from tci.drivers.diagnosis import Level
from tci.errors import CommandError
from tci.lab.commissioning.friction import SPAN, SPEEDS, identify, measure_friction, steady
from tci.messages import JointReading
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration, JointFriction, joint_calibration
from tci.robot.json_file import read_json, write_json


def swept(plant: Plant, joint: int) -> list[JointReading]:
    """Returns the steady readings of two sweeps of one joint of a simulated arm."""
    seen, home = [], plant.target.copy()
    for _ in range(200):
        plant.step(target=home)
    for speed in SPEEDS:
        for way in (1.0, -1.0):
            part = []
            for _ in range(round(SPAN / speed / PERIOD)):
                target = plant.target.copy()
                target[joint] += way * speed * PERIOD
                part.append(plant.step(target=target))
            seen += steady(part, int(plant.servos[joint]), speed)
    return seen


@pytest.mark.parametrize("joint", [3])
def test_two_slow_sweeps_find_friction_although_masses_are_wrong(joint: int) -> None:
    robot = bare_body().robot
    plant = Plant(robot, seed=1, amplitude=0.0)
    limit = plant.limit[joint]
    dynamics = Dynamics(robot, JointCalibration(robot=robot.name))
    found = identify(swept(plant, joint), int(plant.servos[joint]), dynamics)
    assert found.coulomb == pytest.approx(COULOMB * limit, rel=0.2)
    assert found.viscous == pytest.approx(VISCOUS * limit, abs=0.6 * VISCOUS * limit)


def test_the_friction_of_simulated_joints_is_written_beside_what_was_known(tmp_path: Path) -> None:
    """Simulated joints have no friction. The rotor inertias in the robot's file are kept."""
    source = tmp_path / "bare.xml"
    for file in Path(tci.load_robot("g1-bare").source).parent.glob("*.xml"):
        (tmp_path / file.name).write_text(file.read_text())
    name, file = "left_elbow_joint", tmp_path / "bare.joints.json"
    before = JointCalibration(robot="g1-bare", friction={name: JointFriction(coulomb=1.0, rotor=0.01)})
    write_json(file, before)
    robot = tci.load_robot(source)
    assert joint_calibration(robot) == before
    elbow = next(servo for servo in robot.servos if servo.name == name)
    leg = next(servo for servo in robot.servos if servo.name == "left_knee_joint")
    with tci.connect(robot, "sim") as driver:
        (finding,) = measure_friction(driver, Simulation(driver), [leg, elbow], file)
    assert finding.level is Level.OK
    found = read_json(file, JointCalibration)
    assert set(found.friction) == {name}
    assert found.friction[name].coulomb < 0.02
    assert found.friction[name].viscous < 0.1
    assert found.friction[name].rotor == 0.01


def test_friction_of_a_robot_that_feels_nothing_through_joints_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="felt_through_joints"):
        check_hardware("nao", via="sim", parts=[], taxels=0, friction=tmp_path / "f.json", as_json=True)
