"""What the soles of a standing robot bear, and whether it still stands after a motion of a leg."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.gate.contact.balance import LOADED, Balance
from tci.messages import Contact, Support
from tci.messages.frames import Array
from tci.robot.description import SOLE, Robot
from tci.robot.joint_map import joint_map


class StaticStability:
    """Predicts the static stability of one robot after a motion of a leg."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._balance = robot, Balance(robot)
        self._soles = [patch for patch in robot.patches if patch.segment == SOLE]

    def support(self, contacts: Iterable[Contact], position: Array, part: str, target: Array) -> Support:
        """Returns the support of the robot after a motion of the leg `part` to generic angles `target` (n,)
        [rad].

        The forces on the soles are those of `contacts`. Before the motion, the servos are at `position`
        (n_servos,) [rad]. Raises UnknownNameError for an unknown part.
        """
        forces = dict.fromkeys([patch.part for patch in self._soles], 0.0)
        for contact in contacts:
            if contact.segment == SOLE:
                forces[contact.part] += contact.force
        others = [p for p in self._soles if p.part != part and forces[p.part] >= LOADED]
        joints = joint_map(self._robot, part)
        there = np.array(position)
        there[joints.servos] = joints.to_robot(target, position)
        return Support(forces, self._balance.margin(others, position, there))
