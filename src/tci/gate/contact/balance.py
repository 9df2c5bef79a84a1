"""Whether a standing robot still stands after an arm went back, or a leg.

The ground is assumed to be horizontal, so that the normal of a loaded sole is vertical. A posture is
statically stable while the centre of mass lies over the polygon around the loaded soles (Vukobratovic and
Borovac 2004).
"""

from __future__ import annotations

from collections.abc import Collection

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
        self._robot = robot
        self._gravity: Gravity | None = None
        self._soles = {patch.name: patch for patch in robot.patches if patch.segment == SOLE}
        if self._soles:
            try:
                self._chain = KinematicChain(robot)
                self._gravity = Gravity(robot)
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

    def margin(self, soles: Collection[Patch], here: Array, there: Array) -> float:
        """How far [m] the centre of mass of the posture `there` is inside the polygon of the loaded `soles`,
        which stay where the posture `here` has them, each (n_servos,) [rad]; negative outside, and -inf
        without soles or masses."""
        if not soles or self._gravity is None:
            return -np.inf
        poses = self._chain.poses(here, [patch.link for patch in soles])
        surfaces = {one.patch: one for one in surfaces_of(self._robot)}
        own = [surfaces[patch.name] for patch in soles]
        corners = np.concatenate([apply(poses[one.link], one.positions) for one in own])
        down = np.concatenate([one.normals @ poses[one.link][:3, :3].T for one in own]).mean(axis=0)
        across = np.linalg.svd(down[None])[2][1:]
        return distance_inside(across @ self._gravity.centre_of_mass(there), corners @ across.T)

    def tips(self, soles: Collection[Patch], here: Array, there: Array) -> bool:
        """True if the centre of mass leaves the polygon of the loaded `soles` between the postures `here` and
        `there`, each (n_servos,) [rad]. The feet stay where they are. If it is outside `here`, too, the
        masses or the soles are not what they seem, and nothing is known."""
        return self.margin(soles, here, here) >= 0.0 > self.margin(soles, here, there)


def distance_inside(point: Array, corners: Array) -> float:
    """How far a point (2,) is inside the convex hull of corners (n, 2); negative outside, -inf if they span
    no area."""
    rows = sorted(map(tuple, (corners - point).tolist()))
    hull = _chain(rows) + _chain(rows[::-1])
    sides = np.array(hull)[[*range(1, len(hull)), 0]] - np.array(hull)
    lengths = np.linalg.norm(sides, axis=1)
    if len(hull) < 3 or not lengths.all():
        return -np.inf
    return float(((sides[:, 1] * np.array(hull)[:, 0] - sides[:, 0] * np.array(hull)[:, 1]) / lengths).min())


def _chain(rows: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """One side of the hull of sorted `rows`, without its end (Andrew 1979)."""
    kept: list[tuple[float, ...]] = []
    for x, y in rows:
        while len(kept) > 1 and (
            (kept[-1][0] - kept[-2][0]) * (y - kept[-2][1]) <= (kept[-1][1] - kept[-2][1]) * (x - kept[-2][0])
        ):
            kept.pop()
        kept.append((x, y))
    return kept[:-1]
