"""Between two persons whom skin feels on both sides: where a group goes so that neither is pressed."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from tci.errors import DescriptionError
from tci.gate.contact.group import Group
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
SHORT = 0.03
"""Lever [m] below which a joint does not leave anybody: it would turn far, and press elsewhere."""


class Between:
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

    def leave(
        self,
        group: Group,
        seen: Seen,
        contacts: Iterable[Contact],
        *,
        felt: float,
        now: float,
        tips: Callable[[Array], bool],
    ) -> Array | None:
        """With each new frame, where a group goes (k,) [rad] that presses two persons; None if there are none
        or if it can't.

        Args:
            group: on its way back.
            seen: what the reading says.
            contacts: of all skin.
            felt: force [N] on each from which on it does.
            now: time [s].
            tips: whether a robot that stands would not stand any more at such a goal.
        """
        first = group.first
        if first is None or self._chain is None or group.thing or seen.felt.force <= LIGHT:
            return None
        if not (group.answer == "retreat" or group.slow):
            return None
        if not first.between:
            if min(seen.felt.sides) <= felt:
                return None
            group.path.clear()
            group.first = first = first.next(seen, now, between=True)
        frame = {identity: one.force for identity, one in seen.felt.contacts.items()}
        if frame == first.frame:
            return group.goal
        first.frame = frame
        pull = group.references(seen.reference, seen.joints.position) - seen.here
        mine = [one for one in contacts if one.part in group.parts and one.force > LIGHT]
        goal = seen.here + self._way(seen, pull, mine)
        first.between = not tips(goal)
        return group.goes(goal) if first.between else None

    def _way(self, seen: Seen, pull: Array, contacts: Iterable[Contact]) -> Array:
        """The least way (k,) [rad] by which each contact's place goes in as far as it is pressed in."""
        rows, depths = [np.zeros(len(seen.servos))], [0.0]
        for one in contacts:
            rows.append(self._into(seen, one))
            depths.append(one.force / STIFF + ROOM)
        into = np.array(rows)
        square = into @ into.T + SHORT**2 * np.eye(len(rows))
        way: Array = -into.T @ np.linalg.solve(square, np.array(depths))
        stuck = SOFT * FRICTION  # dry friction holds a joint whose reference is not further ahead
        way += np.where(pull * way > 0.0, np.clip(pull, -stuck, stuck), 0.0)
        return np.clip(way, -FURTHER, FURTHER)

    def _into(self, seen: Seen, contact: Contact) -> Array:
        """How far [m/rad] a place of the skin goes into whoever touches it, by each joint (k,)."""
        assert self._chain is not None
        moved = self._chain.jacobian(seen.joints.position, self._links[contact.patch], point=contact.p_L)[:3]
        found: Array = np.where(seen.own, contact.n_T @ moved[:, seen.servos], 0.0)
        return found

    def leads(self, group: Group, seen: Seen, contacts: Iterable[Contact]) -> bool:
        """True if whoever presses a group most stands where it came from: its way back would not leave them,
        or press them."""
        into = self._into_strongest(group, seen, contacts)
        return bool(into.any() and into @ group.path.came(seen.here, seen.own) > -ROOM)

    def forget_way_in(self, group: Group, seen: Seen, contacts: Iterable[Contact]) -> None:
        """Forgets the path of a group that somebody leads, if it came from nearer to them: back along it, the
        group would press them. What it goes into them later is its way back."""
        if self._into_strongest(group, seen, contacts) @ group.path.came(seen.here, seen.own) > 0.0:
            group.path.clear()

    def speed_into(self, group: Group, seen: Seen, contacts: Iterable[Contact]) -> float:
        """Speed [m/s] with which a group's reference goes into whoever presses it most."""
        rates = np.zeros(len(seen.joints.position))
        rates[seen.reference.servos] = seen.reference.velocity
        return float(self._into_strongest(group, seen, contacts) @ rates[seen.servos])

    def _into_strongest(self, group: Group, seen: Seen, contacts: Iterable[Contact]) -> Array:
        """As `_into`, of a group's strongest contact; zeros without one."""
        mine = [one for one in contacts if one.part in group.parts]
        if self._chain is None or not mine:
            return np.zeros(len(seen.servos))
        return self._into(seen, max(mine, key=lambda one: one.force))
