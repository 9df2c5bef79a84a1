"""Whether what a part met is the robot itself, or a declared fixture: nobody is to be freed there."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError
from tci.gate.contact.felt import FeltContact
from tci.messages.frames import Array
from tci.robot.clearance import Clearance, Fixture, Near
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain

THINNER = 0.008
"""Gap [m] between a link and a thing in which nobody is: a finger, a child's too, is thicker."""
SPREAD = 0.04
"""Distance [m] between a contact's centre and the nearest places of a link and a thing: flat links lie on
each other over centimetres, and this centre is somewhere there."""
TOWARDS = 0.5
"""Cosine of the angle from a contact's outward normal to the thing that touches there."""
INTO = 0.001
"""Gap [m] at the posture where a joint should be below which the thing is what holds it."""


class Things:
    """Knows the robot's links, and fixtures beside it."""

    def __init__(self, robot: Robot, fixtures: tuple[Fixture, ...]) -> None:
        """Raises DescriptionError for fixtures beside a robot without model, TciError for two of one name."""
        self._clearance: Clearance | None
        try:
            self._clearance = Clearance(robot, fixtures)
            chain = KinematicChain(robot)
            self._movers = {link: frozenset(chain.chain(link)) for link in chain.links}
        except DescriptionError:  # without a model every contact may be somebody
            if fixtures:
                raise
            self._clearance, self._movers = None, {}

    def met(
        self,
        servos: NDArray[np.intp],
        here: Array,
        reference: Array,
        contacts: Collection[FeltContact],
        others: Mapping[str, Collection[FeltContact]],
    ) -> str | None:
        """What explains every contact of a group, and of the links that it met, in words; None if one of them
        may be somebody.

        Args:
            servos: of the group (k,).
            here: angles of all servos (n_servos,) [rad].
            reference: where they should be (n_servos,) [rad].
            contacts: those on the group's skin. Without one, a joint is held, and a thing is what holds it
                only if the way to the reference leads into it.
            others: those on skin of other parts, by the name of its link.
        """
        if self._clearance is None:
            return None
        moved = {*servos.tolist()}
        near = [one for one in self._clearance.near(here, within=THINNER) if self._of(one, moved)]
        felt = {link: others.get(link, ()) for one in near for link in one[:2]}
        if not near or any(self._cause(one, near, moved, -1.0) is None for on in felt.values() for one in on):
            return None
        if contacts:
            causes = [self._cause(one, near, moved) for one in contacts]
            return None if None in causes else causes[0]
        pairs = {one[:2] for one in near}
        ahead = self._clearance.near(reference, within=INTO)
        into = [one for one in ahead if one[:2] in pairs]
        return self._name(min(into, key=lambda one: one.distance), moved) if into else None

    def _of(self, one: Near, moved: Collection[int]) -> bool:
        """True if the group moves exactly one of the two."""
        return self._moves(one.first, moved) is not self._moves(one.second, moved)

    def _cause(
        self, felt: FeltContact, near: Iterable[Near], moved: Collection[int], side: float = 1.0
    ) -> str | None:
        """The thing that touches where a contact is felt by the group, or (`side` -1) by the thing."""
        for one in sorted(near, key=lambda one: float(np.linalg.norm(felt.point - one.p_T))):
            way = side * (one.way_T if self._moves(one.first, moved) else -one.way_T)
            if np.linalg.norm(felt.point - one.p_T) < SPREAD and (
                felt.normal @ way > TOWARDS or not way.any()
            ):
                return self._name(one, moved)
        return None

    def _moves(self, link: str, moved: Collection[int]) -> bool:
        return not self._movers.get(link, frozenset()).isdisjoint(moved)

    def _name(self, one: Near, moved: Collection[int]) -> str:
        other = one.second if self._moves(one.first, moved) else one.first
        return f"the {other}" if other.startswith("fixture ") else f"its own {other}"
