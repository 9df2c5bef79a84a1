"""Parts that wait while another part frees somebody whom they could press, too."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tci.errors import DescriptionError
from tci.gate.contact.felt import Felt
from tci.gate.contact.group import Group
from tci.gate.joint_monitor import Reference
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain

REACH = 0.4
"""Distance [m] from where somebody is met within which they still are: the width of a chest."""
NEARS = 0.01
"""Speed [m/s] of a link towards them that counts."""


class Waiting:
    """Remembers which groups wait, until nobody is met any more."""

    def __init__(self, robot: Robot, groups: Mapping[int, Group]) -> None:
        self._groups = groups
        self.forget()
        self._chain: KinematicChain | None = None
        self._links = dict[int, list[str]]()
        try:
            chain = self._chain = KinematicChain(robot)
        except DescriptionError:  # without a model only the waist is known to carry others
            return
        for number, group in groups.items():
            self._links[number] = [one for one in chain.links if not group.own.isdisjoint(chain.chain(one))]

    def forget(self) -> None:
        self._numbers = frozenset[int]()
        self.servos = frozenset[int]()
        """Those that wait."""

    def look(self, felt: Mapping[int, Felt], position: Array, reference: Reference) -> list[Reason]:
        """Tells which groups begin to wait: the waist, which carries whoever presses, and those one of whose
        links nears a place where somebody is met. If skin does not feel them, they may be at any link of the
        group that meets them."""
        groups, there, who = self._groups, list[Array](), list[str]()
        for number, one in groups.items():
            if one.answers and not one.thing:
                skin = felt.get(number, Felt()).contacts.values()
                there += [contact.point for contact in skin] or self._at(number, position)
                who.append(one.name)
        if not who:
            if all(one.goal is None or one.thing for one in groups.values()):
                self.forget()
            return []
        speed = np.zeros(len(position))
        speed[reference.servos] = reference.velocity
        fresh = [
            number
            for number, one in groups.items()
            if number not in self._numbers and one.goal is None and speed[one.servos].any()
            if one.waist or self._nears(number, there, position, speed)
        ]
        self._numbers |= {*fresh}
        self.servos = frozenset(servo for number in self._numbers for servo in groups[number].own)
        words = f"waits, since {' and '.join(who)} met somebody whom it could press, too"
        return [Reason(Code.CONTACT, f"{groups[number].name} {words}") for number in fresh]

    def _at(self, number: int, position: Array) -> list[Array]:
        if self._chain is None:
            return []
        poses = self._chain.poses(position, self._links[number])
        return [pose[:3, 3] for pose in poses.values()]

    def _nears(self, number: int, there: list[Array], position: Array, speed: Array) -> bool:
        if self._chain is None or not there:
            return False
        points = np.array(there)
        poses = self._chain.poses(position, self._links[number])
        for link, pose in poses.items():
            ways = points - pose[:3, 3]
            apart = np.linalg.norm(ways, axis=1)
            near = (apart < REACH) & (apart > 0.0)
            moves = self._chain.jacobian(position, link)[:3] @ speed
            if near.any() and (ways[near] @ moves / apart[near] > NEARS).any():
                return True
        return False
