"""Whether a standing robot still stands after an arm went back."""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, UnknownNameError
from tci.messages import Contacts
from tci.messages.frames import Array, apply
from tci.robot.description import SOLE, Patch, Robot
from tci.robot.gravity import Gravity
from tci.robot.kinematics import KinematicChain
from tci.skin.surfaces import surfaces_of

LOADED = 1.0
"""Least force [N] at which a sole counts as loaded. Assumed: the force of a foot that stands on the ground is
far larger than this, and noise is smaller."""


class Balance:
    """Knows the soles, masses and links of one robot. Without soles, or without masses, no robot is known to
    stand."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._gravity = robot, None
        self._soles = {patch.name: patch for patch in robot.patches if patch.segment == SOLE}
        if self._soles:
            try:
                self._gravity, self._chain = Gravity(robot), KinematicChain(robot)
            except (DescriptionError, UnknownNameError):
                self._soles = {}

    @property
    def known(self) -> bool:
        """True if it can be told whether the robot stands."""
        return bool(self._soles)

    def loaded(self, contacts: Contacts) -> list[Patch]:
        """The soles on which the robot stands."""
        if not self._soles:
            return []
        pressed = zip(contacts.site.tolist(), contacts.force.tolist(), strict=True)
        names = {contacts.sites[site].patch for site, force in pressed if force >= LOADED}
        return [patch for name, patch in self._soles.items() if name in names]

    def tips(self, soles: list[Patch], here: Array, there: Array) -> bool:
        """True if the centre of mass leaves the polygon of the loaded `soles` between the postures `here` and
        `there`, each (n_servos,) [rad]. The feet stay where they are. If it is outside `here`, too, the
        masses or the soles are not what they seem, and nothing is known."""
        if not soles or self._gravity is None:
            return False
        poses = self._chain.poses(here, [patch.link for patch in soles])
        surfaces = {one.patch: one for one in surfaces_of(self._robot)}
        own = [surfaces[patch.name] for patch in soles]
        corners = np.concatenate([apply(poses[one.link], one.positions) for one in own])
        down = np.concatenate([one.normals @ poses[one.link][:3, :3].T for one in own]).mean(axis=0)
        across = np.linalg.svd(down[None])[2][1:]
        inside = [
            _surrounded(across @ self._gravity.centre_of_mass(angles), corners @ across.T)
            for angles in (here, there)
        ]
        return inside[0] and not inside[1]


def _surrounded(point: Array, corners: Array) -> bool:
    """True if a point (2,) is inside the convex hull of corners (n, 2): no half plane from it is empty."""
    ways = np.sort(np.arctan2(*(corners - point).T))
    return bool(np.diff(ways, append=ways[0] + 2.0 * np.pi).max() < np.pi)
