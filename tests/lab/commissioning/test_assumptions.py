"""Limits that contradict the masses of the model are told, with what would be valid."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from helpers.gate_checks import LIMITS, make_robot
from helpers.rigid_robot import CLEAN, RigidRobot
from tci.lab.commissioning.assumptions import powers, too_quick
from tci.messages import CONTROL_MODES
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize(("torque", "told"), [(5.1, False), (4.9, True)])
def test_an_acceleration_that_takes_more_than_the_torque_is_told(torque: float, told: bool) -> None:
    """Links of 0.125 kg m2 at 40 rad/s2 take 5 N m."""
    robot = make_robot(limits=LIMITS.model_copy(update={"torque": torque}), modes=CONTROL_MODES)
    found = too_quick(robot)
    assert len(found) == 6 * told
    assert all("takes 5 N m" in one and "valid: at most 1684 degrees/s2" in one for one in found)


def test_an_arms_energy_is_that_of_the_model_at_its_speed_limits() -> None:
    robot = load_robot("icub").model_copy(update={"patches": ()})
    told = powers(robot)
    assert [one.split(":")[0] for one in told] == ["left_arm", "right_arm"]
    energy = float(told[0].split("up to ")[1].split(" J")[0])
    plant = RigidRobot(robot, dirt=CLEAN)
    own = [one.servo for one in robot.part("left_arm").servos]
    dofs = [plant._dof[k] for k, servo in enumerate(plant._servo) if servo in own]
    plant.model.dof_armature[:] = 0.0
    mujoco.mj_forward(plant.model, plant.data)
    speeds = np.zeros(plant.model.nv)
    speeds[dofs] = [robot.servos[servo].limits.velocity for servo in sorted(own)]
    here = plant.energy_at(speeds)
    assert 0.3 * energy <= here <= 1.1 * energy
