"""Torques that sensors at the outputs of simulated joints would measure."""

from __future__ import annotations

import numpy as np

from tci.engine import mujoco
from tci.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.gravity import Gravity
from tci.robot.kinematics import joints_of
from tci.simulation.physics import Physics


class JointTorques:
    """Torques between motors and links: what moves the links and holds them against their weight and touches.

    A robot on a fixed base is simulated without weight, since its servos have no integral action; the torque
    that holds it is added here.
    """

    def __init__(self, physics: Physics, robot: Robot, *, stands: bool) -> None:
        """Raises what Gravity raises."""
        self._physics = physics
        self._gravity = None if stands else Gravity(robot)
        servos, _, columns = joints_of(robot, physics.model)
        self._servos, self._columns = np.array(servos), np.array(columns)
        self._moving = np.zeros(physics.model.nv)

    def measured(self, position: Array) -> Array:
        """Returns the torques (n_servos,) [N m] of the latest step, at the angles `position` (n_servos,)
        [rad]."""
        model, data = self._physics.model, self._physics.data
        mujoco.mj_rne(model, data, 1, self._moving)
        output = self._moving - data.qfrc_constraint - data.qfrc_passive
        torques = np.zeros(len(position)) if self._gravity is None else self._gravity.torques(position)
        torques[self._servos] += output[self._columns]
        return read_only(torques)
