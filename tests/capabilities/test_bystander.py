"""Whoever stands in the way of a withdrawal is struck no harder than people may be."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from helpers.struck import draw, strike
from tci.capabilities import WithdrawalReflex
from tci.robot.blow import Striker, Strikers, Struck, spared
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration
from tci.robot.kinematics import KinematicChain

WALL = Struck(name="wall", stiffness=25e3, mass=1e6, force=280.0)


def test_without_servos_a_blow_is_that_of_the_mass() -> None:
    free = Striker(2.0, 0.0, 0.0, 0.0)
    assert free.force_on(WALL, 0.5) == pytest.approx(0.5 * np.sqrt(2.0 * 25e3), rel=0.02)
    assert free.force_on(WALL, 2.0 * spared([(*free, 2.0)], [WALL])[0]) == pytest.approx(280.0, rel=0.02)


def test_a_chest_in_the_way_of_a_talos_is_spared() -> None:
    robot, fast = tci.load_robot("talos"), WithdrawalReflex(people=())
    trial = draw(robot, 22, fast, full=True)
    assert trial is not None
    before, told = strike(robot, trial, fast), []
    hit = before.hit
    assert hit is not None
    assert before.peak > 2.0 * trial.region.limit
    inertia, _ = Dynamics(robot, JointCalibration(robot=robot.name)).at(
        hit.position, np.zeros(len(hit.position))
    )
    moved = hit.normal @ KinematicChain(robot).jacobian(hit.position, hit.link, point=hit.point)[:3]
    one, region = Strikers(robot).behind(inertia, moved), trial.region
    assert one is not None
    struck = Struck(name=region.name, stiffness=region.stiffness, mass=region.mass, force=2.0 * region.limit)
    assert one.force_on(struck, float(moved @ hit.velocity)) == pytest.approx(before.peak, rel=0.25)
    after = strike(
        robot, trial, WithdrawalReflex(),
        told=lambda memory: told.append(max((one.pace.force for one in memory.values()), default=0.0)),
    )  # fmt: skip
    assert after.peak <= 2.0 * region.limit
    assert after.peak <= max(told) < np.inf
