"""The generic body: both halves of the interface (Fig. 2, L3) for one robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from tci.body.cartesian import cartesian_to_platform
from tci.body.coverage import Coverage
from tci.body.landmarks import Landmarks
from tci.body.posture import generic_columns, switch, to_platform
from tci.body.retreat import Retreat
from tci.body.support import StaticStability
from tci.frames import Array, read_only
from tci.messages import (
    CartesianCommand,
    Contact,
    Covered,
    GenericCommand,
    JointReading,
    Landmark,
    Order,
    Perception,
    PlatformCommand,
    PlatformOrder,
    PlatformSwitch,
    Reading,
    SkinFrame,
    SwitchMode,
)
from tci.robot.description import Robot
from tci.robot.joint_map import generic_posture
from tci.skin.contact_table import identities
from tci.skin.contacts import ContactSettings, find_contacts
from tci.skin.send_on_delta import HoldLast
from tci.skin.skin import Skin
from tci.skin.tracking import Tracker


class GenericBody:
    """What capabilities see of a robot, and how they move it."""

    def __init__(
        self, robot: Robot, *, contacts: ContactSettings | None = None, keep_alive: float | None = None
    ) -> None:
        """With a `keep_alive` [s] the skin's senders send changes only, each patch at least once in that
        time; None: every frame. What is perceived is the same."""
        self.robot = robot
        self._filled = None if keep_alive is None else HoldLast(robot, keep_alive)
        self.skin = Skin(robot)
        self._settings = contacts or ContactSettings()
        self._frames: tuple[SkinFrame, ...] = ()
        self._patches = self.skin.felt
        self._contacts: Sequence[Contact] = ()
        self._tracker = Tracker()
        self._coverage = Coverage(self.skin)
        self._movable = {
            part.name: read_only([float(joint.servo is not None) for joint in part.servos])
            for part in robot.parts
        }
        self.spots = Landmarks(self.skin)
        """Distances along the skin where there is no limb."""
        self._balance = StaticStability(self.skin)
        self.retreat = Retreat(self.skin).along
        """Where motions of generic parts lead: see `Retreat.along`."""
        self._covered: Covered | None = None

    def perceive(self, reading: Reading, now: float) -> Perception:
        """Generic posture and contacts at time `now` [s] (eqs 1-4, 7).

        Contacts are looked for once per skin frame. Raises FrameError when a frame does not fit the
        robot.
        """
        posture = generic_posture(self.robot, reading.joints)
        if self._filled is not None:
            reading = replace(reading, skin=self._filled.fill(reading.skin, now))
        ended: tuple[int, ...] = ()
        if reading.skin != self._frames:
            self.skin.update(reading)
            self._frames = reading.skin
        if self.skin.felt is not self._patches:
            ended = self._find(posture)
            self._covered = self._coverage.step(reading.joints)
        else:
            self.skin.learn()
        position = reading.joints.position
        return Perception(
            stamp=now,
            posture=posture,
            contacts=self._contacts,
            ended=ended,
            jacobian=lambda contact: self.jacobian(contact, position),
            retreat=partial(self.retreat, position),
            apart=self.spots.distance,
            movable=self._movable,
            covered=self._covered,
            felt=None if self._covered is None else self._felt,
            support=lambda part, target: self._balance.support(self._contacts, position, part, target),
        )

    def _find(self, posture: Mapping[str, Array]) -> tuple[int, ...]:
        """Look for contacts; the identities of those that are no more."""
        before = identities(self._contacts)
        self._contacts = find_contacts(
            self.skin, self.skin.state, posture, settings=self._settings, tracker=self._tracker
        )
        self._patches = self.skin.felt
        now = identities(self._contacts)
        return () if before == now else tuple([int(one) for one in before if one not in now])

    def _felt(self, part: str, spot: Landmark, radius: float) -> float:
        """The share 0..1 of the taxels around a spot that are used; 1 where there are none."""
        found = self.spots.around(part, spot, radius)
        state = None if found is None else self.skin.state.patches.get(found[0])
        if found is None or state is None or state.masked is None or not found[1].any():
            return 1.0
        return 1.0 - float(state.masked[found[1]].mean())

    def jacobian(self, contact: Contact, position: Array) -> Array:
        """How a contact's point moves (3, n) [m/rad], seen from the torso, with its part's generic joints.

        `position` (n_servos,) [rad] is that of the robot's servos. A generic joint that the robot lacks
        moves nothing. Its transpose takes a force at the contact to generic torques.
        """
        link = self.robot.patch(contact.patch).link
        moved = self.skin.kinematics.jacobian(position, link, point=contact.p_L)[:3]
        return read_only(generic_columns(self.robot, contact.part, moved, position))

    def to_platform(self, orders: Iterable[Order] | Order, joints: JointReading) -> list[PlatformOrder]:
        """The same orders, or a single one, in the robot's own joints, which are as `joints` says (inverse of
        eqs 1-2).

        Raises CommandError.
        """
        several = (orders,) if isinstance(orders, Order) else orders
        return [order_to_platform(self.robot, order, joints.position) for order in several]


def order_to_platform(robot: Robot, order: Order, position: Array) -> PlatformOrder:
    """One order in the robot's own joints, whose servos are at `position` (n_servos,) [rad].

    One that is in them already comes back as it is. Raises CommandError.
    """
    match order:
        case PlatformCommand() | PlatformSwitch():
            return order
        case SwitchMode():
            return switch(robot, order)
        case CartesianCommand():
            return cartesian_to_platform(robot, order, position)
        case GenericCommand():
            return to_platform(robot, order, position=position)
