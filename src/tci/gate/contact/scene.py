"""What the answers of all groups share: the robot, what is known of its contacts, and the present."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from tci.gate.contact.balance import Balance
from tci.gate.contact.bearing import Bearing
from tci.gate.contact.felt import FeltContact, FeltForces
from tci.gate.contact.following import PROGRESS, Following
from tci.gate.contact.group import Group
from tci.gate.contact.noticing import Seen
from tci.gate.contact.overloads import Overloads
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.places import Places
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.softness import LIGHT
from tci.gate.contact.things import Things
from tci.messages import Contact
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot

MADE = 0.3
"""Time [s] after its reference moved last within which a part may have made a contact."""
SHOWS = 0.1
"""Time [s] in which some readings come."""


class Scene:
    """The robot, and what the latest reading tells of it as a whole."""

    def __init__(
        self,
        robot: Robot,
        settings: ContactSettings,
        balance: Balance,
        weight: OwnWeight,
        groups: Mapping[int, Group],
        parts: Mapping[str, Collection[int]],
    ) -> None:
        """`parts` names the numbers of each generic part's `groups`."""
        self.robot, self.settings, self.balance = robot, settings, balance
        self.forces = FeltForces(parts, lambda number: self.moves(groups[number]))
        self.following = Following(
            len(robot.servos), held=settings.held, lag=settings.lag, known=settings.stands
        )
        self.things = Things(robot, settings.fixtures)
        self.places = Places(robot)
        self.bearing = Bearing(robot, weight, known=settings.stands)
        self.overloads = Overloads(robot)
        self._softens = settings.softens and weight.known
        self.soles: list[Patch] = []
        """Those that are loaded."""
        self.contacts: Collection[Contact] = ()
        """Of all skin."""
        self.now = -float("inf")
        """[s]"""

    def on(self, group: Group) -> list[Contact]:
        """Contacts on the skin of a group."""
        return [one for one in self.contacts if one.part in group.parts]

    def allowed(self, group: Group) -> float:
        """Force [N] on a group's skin up to which it is left to people, or to a capability."""
        return max(self.settings.felt_of(group.parts), self.handled(group))

    def softens(self, group: Group) -> bool:
        """True if a group goes back softly. An upright trunk would topple, since its weight pushes it the
        further the more it leans."""
        return self._softens and not group.waist

    def handled(self, group: Group) -> float:
        """Force [N] on a group's skin that a capability handles."""
        return group.expected if self.now < group.until else 0.0

    def tips(self, group: Group, seen: Seen, goal: Array) -> bool:
        """True if a standing robot would not stand any more with the group at `goal` (k,) [rad]."""
        there = seen.joints.position.copy()
        there[group.servos] = goal
        return self.balance.tips(self.soles, seen.joints.position, there)

    def thing(self, group: Group, seen: Seen) -> str | None:
        """What the group met if nobody is to be freed there, in words."""
        reference = seen.joints.position.copy()
        reference[seen.reference.servos] = seen.reference.position
        felt = [one for one in seen.felt.contacts.values() if one.force > LIGHT]
        others: dict[str, list[FeltContact]] = {}
        for one in self.contacts:
            if one.part not in group.parts and one.force > LIGHT:
                link = self.robot.patch(one.patch).link
                others.setdefault(link, []).append(FeltContact(one.force, one.n_T, one.p_T))
        return self.things.met(group.servos, seen.joints.position, reference, felt, others)

    def moves(self, group: Group) -> bool:
        """True if a group may have made a contact: it moves, or did a moment ago, and not because somebody
        pushes it."""
        return not group.softness.soft and self.now - group.moved < MADE

    def may_hold(self, group: Group) -> bool:
        """True if what holds a joint now may have been met by the group's own motion: also if that shows only
        once nothing lags any more."""
        least = max(MADE, self.settings.lag + PROGRESS + SHOWS)
        return not group.softness.soft and self.now - group.moved < least

    def rests(self, group: Group) -> bool:
        """True if a group has rested for so long that nothing lags any more."""
        return self.now - group.moved > self.settings.lag + PROGRESS

    def moves_now(self, group: Group) -> bool:
        """True while the latest readings may tell of a reference that moved."""
        return self.now - group.moved <= self.settings.lag
