"""The plant with hands that are simulated beside it: masses that people's arms pull along."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from helpers.rigid_robot import STEP, RigidRobot
from tci.messages.frames import Array

MASS, ARM, DAMPING = 0.6, 300.0, 0.7
"""A hand's mass [kg], the stiffness [N/m] of the arm that moves it, and the ratio of its damping."""


class HandledRobot(RigidRobot):
    """The plant with hands that move before each of its steps."""

    hands: tuple[Any, ...] = ()

    def _drive(self) -> None:
        for hand in self.hands:
            hand.step()
        super()._drive()

    def pressed(self, name: str) -> Array:
        """Force (3,) [N] of a person's surface on whoever holds it."""
        k = [one.name for one in self.people].index(name)
        qpos, dof = self._surfaces[k]
        if not self.data.ncon:
            return np.zeros(3)
        found: Array = (
            self.people[k].stiffness * self.data.qpos[qpos]
            + self.model.dof_damping[dof] * self.data.qvel[dof]
        )
        return found


@dataclass
class Hand:
    """A hand at a place. Once it is met, its person moves it against the arm, by 0.64 s times `speed`, and
    back, again and again."""

    plant: HandledRobot
    name: str
    place: Array
    """(3,) [m] in the world."""
    ahead: Array
    """Direction (3,) in which it goes."""
    speed: float
    """[m/s], at most."""
    first: float | None = None
    """When it was met [s]."""
    gone: bool = False
    _x: Array = field(init=False)
    _v: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        self._x = self.place.copy()

    def step(self) -> None:
        if self.gone:
            return
        spring = self.plant.pressed(self.name)
        if self.first is None and float(np.linalg.norm(spring)) > 1.0:
            self.first = self.plant.time
        turn = 0.0 if self.first is None else np.pi * (self.plant.time - self.first)
        wanted = self.place + self.ahead * self.speed / np.pi * (1.0 - np.cos(turn))
        damper = 2.0 * DAMPING * np.sqrt(ARM * MASS)
        pull = ARM * (wanted - self._x) + damper * (self.ahead * self.speed * np.sin(turn) - self._v) + spring
        self._v = self._v + STEP * pull / MASS
        self._x = self._x + STEP * self._v
        self.plant.shift(self.name, self._x)
