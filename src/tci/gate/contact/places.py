"""How joints move the places that skin feels, and the least way out of there."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.errors import DescriptionError
from tci.gate.contact.noticing import Seen
from tci.gate.contact.path import FURTHER
from tci.gate.contact.softness import LIGHT
from tci.gate.contact.weights import FRICTION, SOFT
from tci.messages import Contact
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain

STIFF = 75e3
"""Stiffness [N/m] of whom it meets: ISO/TS 15066's stiffest. Somebody softer is left in more steps."""
ROOM = 2e-3
"""Distance [m] by which it leaves each: two fit into the 5 mm that the way back keeps from a contact."""
LEAVES = 0.5 * ROOM
"""Distance [m] by which a way must lead out at least: else its joints only slide along there."""
SHORT = 0.03
"""Lever [m] below which a joint does not leave anybody: it would turn far, and press elsewhere."""


class Places:
    """Knows how joints move the places that skin feels."""

    def __init__(self, robot: Robot) -> None:
        self._links = {patch.name: patch.link for patch in robot.patches}
        self._chain: KinematicChain | None = None
        try:
            self._chain = KinematicChain(robot)
        except DescriptionError:
            return
        for link in {*self._links.values()} & {*self._chain.links}:
            self._chain.jacobian(np.zeros(len(robot.servos)), link)  # the first one of each takes longer

    @property
    def known(self) -> bool:
        """Whether the robot has a model."""
        return self._chain is not None

    def into(self, seen: Seen, contact: Contact) -> Array:
        """How far [m/rad] a place of the skin goes into whoever touches it, by each joint (k,)."""
        found: Array = contact.n_T @ self._moved(seen, contact)
        return found

    def into_strongest(self, seen: Seen, contacts: Iterable[Contact]) -> Array:
        """As `into`, of the strongest of a group's own contacts; zeros without one."""
        most = max(contacts, key=lambda one: one.force, default=None)
        return np.zeros(len(seen.servos)) if most is None else self.into(seen, most)

    def speed_out(self, seen: Seen, contacts: Iterable[Contact]) -> tuple[float, float]:
        """Speed [m/s] at which the references move the strongest of a group's own contacts, and the part of
        it that leaves whoever presses there."""
        most = max(contacts, key=lambda one: one.force, default=None)
        if most is None:
            return 0.0, 0.0
        velocity = self._moved(seen, most) @ seen.rates
        return float(np.linalg.norm(velocity)), -float(most.n_T @ velocity)

    def _moved(self, seen: Seen, contact: Contact) -> Array:
        """How far (3, k) [m/rad] each joint moves a place of the skin, in the torso frame."""
        link = self._links.get(contact.patch)
        if self._chain is None or link is None:  # skin that the robot's description does not know
            return np.zeros((3, len(seen.servos)))
        moved = self._chain.jacobian(seen.joints.position, link, point=contact.p_L)[:3]
        found: Array = np.where(seen.own, moved[:, seen.servos], 0.0)
        return found

    def way_out(self, seen: Seen, contacts: Iterable[Contact], pull: Array) -> Array:
        """The least way (k,) [rad] by which each contact's place goes in as far as it is pressed in, and a
        little further where a joint is stuck behind its reference, by `pull` (k,) [rad]."""
        rows, depths = [np.zeros(len(seen.servos))], [0.0]
        for one in contacts:
            rows.append(self.into(seen, one))
            depths.append(one.force / STIFF + ROOM)
        into = np.array(rows)
        square = into @ into.T + SHORT**2 * np.eye(len(rows))
        way: Array = -into.T @ np.linalg.solve(square, np.array(depths))
        stuck = SOFT * FRICTION  # dry friction holds a joint whose reference is not further ahead
        way += np.where(pull * way > 0.0, np.clip(pull, -stuck, stuck), 0.0)
        return np.clip(way, -FURTHER, FURTHER)

    def out(self, seen: Seen, contacts: Iterable[Contact]) -> Array | None:
        """The least way (k,) [rad] by which a group leaves everybody whom its own skin feels; None if there
        is nobody, or if its joints don't lead out of there."""
        pressed = [one for one in contacts if one.force > LIGHT]
        way = self.way_out(seen, pressed, np.zeros(len(seen.servos)))
        leaves = max((float(self.into(seen, one) @ way) for one in pressed), default=0.0) < -LEAVES
        return way if leaves else None
