"""Torques that sensors at the outputs of simulated joints would measure."""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.gravity import Gravity
from tci.robot.kinematics import joints_of
from tci.simulation.physics import Physics, exclusive
from tci.support.engine import mujoco


class JointTorques:
    """Computes the torques with which the motors act on the links.

    A robot on a fixed base is simulated without weight, since the simulated servos have no integral action.
    The torques that would carry the robot's weight are therefore computed separately, and added to the
    simulated torques.
    """

    def __init__(self, physics: Physics, robot: Robot, *, stands: bool) -> None:
        """Prepares the computation for one world. Raises the errors of `Gravity`."""
        self._physics = physics
        self._gravity = None if stands else Gravity(robot)
        servos, _, columns = joints_of(robot, physics.model)
        self._servos, self._columns = np.array(servos), np.array(columns)
        self._moving = np.zeros(physics.model.nv)
        self._inertia, self._damping = np.zeros((2, physics.model.nv, physics.model.nv))
        self._rows = np.repeat(np.arange(physics.model.nv), physics.model.D_rownnz)

    @exclusive
    def measured(self, position: Array) -> Array:
        """Returns the torques (n_servos,) [N m] of the latest step.

        `position` (n_servos,) [rad] are the servos' angles.
        """
        model, data = self._physics.model, self._physics.data
        shown = data.qacc.copy()
        data.qacc[:] = self._acceleration()
        mujoco.mj_rne(model, data, 1, self._moving)
        data.qacc[:] = shown
        output = self._moving - data.qfrc_constraint - data.qfrc_passive
        torques = np.zeros(len(position)) if self._gravity is None else self._gravity.torques(position)
        torques[self._servos] += output[self._columns]
        return read_only(torques)

    def _acceleration(self) -> Array:
        """Returns the acceleration (nv,) of the joints in the latest step, in the order of MuJoCo's `qvel`.

        MuJoCo's `qacc` is not this acceleration, because it neglects that the damping of stiff servos changes
        the acceleration within the step.
        """
        model, data = self._physics.model, self._physics.data
        mujoco.mj_fullM(model, data, self._inertia)
        self._damping[self._rows, model.D_colind] = data.qDeriv
        result: Array = np.linalg.solve(
            self._inertia - self._physics.step * self._damping, self._inertia @ data.qacc
        )
        return result
