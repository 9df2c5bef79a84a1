"""Torques with which a robot's joints hold its own weight, by the masses of the model."""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, UnknownNameError
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.gravity import DOWN, Gravity
from tci.robot.kinematics import KinematicChain


class OwnWeight:
    """Knows a robot's masses. Its root stays upright while a torso leans."""

    def __init__(self, robot: Robot) -> None:
        self._gravity: Gravity | None = None
        try:
            self._gravity, self._chain = Gravity(robot), KinematicChain(robot)
        except (DescriptionError, UnknownNameError):
            return
        self._root = self._chain.links[0]
        self._down = self._turn(np.zeros(len(robot.servos))).T @ DOWN

    @property
    def known(self) -> bool:
        """Whether the model has masses."""
        return self._gravity is not None

    def torques(self, position: Array) -> Array:
        """Torques (n_servos,) [N m] that hold `position` (n_servos,) [rad]; zeros without masses."""
        if self._gravity is None:
            return np.zeros(len(position))
        return self._gravity.torques(position, down=self._turn(position) @ self._down)

    def _turn(self, position: Array) -> Array:
        """Rotation (3, 3) of the root in the torso frame."""
        turn: Array = self._chain.poses(position, [self._root])[self._root][:3, :3]
        return turn
