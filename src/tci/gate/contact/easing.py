"""A part that presses somebody does so as softly as its weight permits: on its way back, and where no way is
known, since encoders or servos are not what they seem. When it is commanded again it gets its stiffness back,
slowly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet

import numpy as np
from numpy.typing import NDArray

from tci.gate.contact.group import Group
from tci.gate.contact.noticing import Seen
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.weights import FRICTION, MOST, SOFT, bends
from tci.messages import Contact
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool

LEAST = 0.1
"""Share of the stiffness that is left at least: dry friction holds a joint with half of it."""
HOLDS, SOFTEST, PRESSING = 1.5, 0.01, 0.001
"""Multiple of its weight and dry friction that a joint bears that goes back from somebody, and shares of the
stiffness that are left at least, the latter while it presses with more than friction: a NAO's servo without
any is off, and one that is softer than needed takes half a second longer to arrive."""
RUBS = 0.5
"""Fraction of its dry friction that a joint bears beside its weight while it still presses: without any, arms
swing into the next person."""
FASTER = 1.5
"""Factor by which the share of a joint rises at once that does not go back, held by dry friction."""
FINE = float(np.deg2rad(0.5))
"""Angle [rad] between a reference and its joint below which nobody knows how stiff the servo is."""
SEEN = 0.03
"""Time [s] from a new share to the reading that tells what a joint bears with it, as a rule. Later ones make
it softer than asked."""
MORE, EVERY = 0.05, 0.1
"""Share of the stiffness that comes back at once, and time [s] between two: a joint that hangs 4 degrees low
rises in 2 s, so slowly that somebody above it is noticed first."""


class Easing:
    """Knows which share of its stiffness holds a part's weight. Without masses it keeps the whole."""

    def __init__(self, robot: Robot, weight: OwnWeight) -> None:
        self._torque = np.array([servo.limits.torque or np.nan for servo in robot.servos])
        self._brakes = np.array([servo.limits.acceleration or np.inf for servo in robot.servos])
        self._weight = weight
        self._eased = set[int]()
        self._full = dict[int, float]()  # shares before, of those that are still softer
        self._raised = -np.inf  # when [s]

    def load(self, robot: Robot, tools: Mapping[str, Tool]) -> None:
        """Notes what links carry, by the name of the link."""
        self._loaded = bends(robot, tools, most=np.inf) - bends(robot, {}, most=np.inf)

    def forget(self) -> None:
        """Angles are what they seem again."""
        self._eased.clear()

    def look(
        self,
        groups: Mapping[int, Group],
        contacts: Iterable[Contact],
        settings: ContactSettings,
        position: Array,
        powered: NDArray[np.bool_] | None,
        now: float,
    ) -> tuple[dict[int, float], list[Reason]]:
        """Shares (0..1) of stiffness by servo, and what to tell, of each group that still answers a contact,
        or whose skin feels more than it answers from on; each once.

        Args:
            groups: by number.
            contacts: of all skin.
            settings: what each part answers from on.
            position: where the robot was last seen (n_servos,) [rad].
            powered: see `shares`.
            now: time [s].
        """
        shares, told = dict[int, float](), list[Reason]()
        for number, group in groups.items():
            felt = max((one.force for one in contacts if one.part in group.parts), default=0.0)
            answers = group.answers or group.noticing.sure
            most = settings.felt_of(group.parts)
            if number in self._eased or group.waist or not (answers or felt > most):
                continue  # a soft waist lets the robot fall
            self._eased.add(number)
            if found := self._ease(group, self.shares(group, position, powered), now):
                shares |= found
                words = f"no way back is known for {group.name}, which presses somebody"
                least = f"{min(found.values()):.0%} to {max(found.values()):.0%}"
                told.append(Reason(Code.CONTACT, f"{words}: its stiffness falls to {least}"))
        return shares, told

    def yields(
        self, group: Group, seen: Seen, weighs: Array, behind: NDArray[np.bool_], now: float
    ) -> dict[int, float]:
        """New shares (0..1) of stiffness, by servo, of a group that presses somebody and goes back: stiff
        servos press with their full torque while references brake. How stiff they are is assumed at first;
        measured torques tell it, where joints would bear `weighs` (n_servos,) [N m] without anybody. Joints
        that stay `behind` (k,) their references get some back."""
        if not self._weight.known or 0.0 <= now - group.eased < SEEN:
            return {}
        group.eased, joints = now, seen.joints
        shares = self._most(group, joints.position)
        if joints.torque is not None:
            bears = np.maximum(np.abs(joints.torque), 1e-9)[group.servos]
            off, rates = seen.references - seen.here, seen.rates
            brakes = np.where(off * rates > 0.0, rates**2 / (2.0 * self._brakes[group.servos]), 0.0)
            bears *= 1.0 + brakes / np.maximum(np.abs(off), FINE)
            own, dry = weighs[group.servos], FRICTION * self._torque[group.servos]
            extra = joints.torque[group.servos] - own
            presses = extra * group.push > 0.0
            asked = np.where(presses, np.abs(own) + RUBS * dry, HOLDS * (np.abs(own) + dry)) / bears
            asked = np.fmin(np.where(behind, FASTER, 1.0), asked)
            least = np.where(presses & (np.abs(extra) > dry), PRESSING, SOFTEST)
            shares = np.minimum(np.maximum(group.sags.shares * asked, least), shares)
        return self._ease(group, _changed(group, shares, joints.powered), now)

    def shares(self, group: Group, position: Array, powered: NDArray[np.bool_] | None) -> dict[int, float]:
        """Shares (0..1) of the group's stiffness, by servo, at which gravity bends no joint by more than a
        weight may, as far as they are less than now. Servos without power keep theirs.

        Args:
            group: which presses.
            position: where the robot was last seen (n_servos,) [rad].
            powered: which servos have power (n_servos,), if that is known.
        """
        if not self._weight.known:
            return {}
        shares = np.minimum(self._least(group, position), group.sags.shares)
        return _changed(group, shares, powered)

    def _least(self, group: Group, position: Array) -> Array:
        least: Array = np.clip(self._bent(position) / MOST, LEAST, 1.0)[group.servos]
        return least

    def _most(self, group: Group, position: Array) -> Array:
        """Shares (k,) that a group gets at most on its way back: what holds its weight, and never more than
        before."""
        rows = zip(group.servos.tolist(), group.sags.shares.tolist(), strict=True)
        full = np.array([self._full.get(servo, share) for servo, share in rows])
        most: Array = np.fmin(self._least(group, position), full)
        return most

    def _ease(self, group: Group, shares: dict[int, float], now: float) -> dict[int, float]:
        """Notes shares that a group gets: it gets its stiffness back later."""
        if shares:
            before = zip(group.servos.tolist(), group.sags.shares.tolist(), strict=True)
            self._full = {servo: share for servo, share in before if servo in shares} | self._full
            group.sags.told(np.array([*shares]), np.array([*shares.values()]), now)
        return shares

    def told(self, servos: NDArray[np.intp]) -> None:
        """Somebody said how stiff `servos` (k,) are."""
        for servo in servos.tolist():
            self._full.pop(servo, None)

    def give_back(
        self,
        groups: Mapping[int, Group],
        pressed: AbstractSet[str],
        position: Array,
        commanded: NDArray[np.intp],
        powered: NDArray[np.bool_] | None,
        now: float,
    ) -> dict[int, float]:
        """New shares (0..1) of stiffness, by servo, of those that got a smaller one and are commanded again.
        Parts that are `pressed` stay as soft as they are.

        Args:
            groups: by number.
            pressed: names of parts that meet somebody.
            position: of all servos (n_servos,) [rad].
            commanded: those under command (k,).
            powered: see `shares`.
            now: time [s].
        """
        found = dict[int, float]()
        if not self._weight.known or not self._full or 0.0 <= now - self._raised < EVERY:
            return found
        self._raised = now
        on = commanded if powered is None else commanded[powered[commanded]]
        mine = self._full.keys() & on.tolist()
        bent = self._bent(position)
        for group in groups.values():
            own, rises = group.own & mine, group.goal is None and pressed.isdisjoint(group.parts)
            for servo in own:
                before = group.sags.share_of(servo)
                share = min(before + MORE, self._full[servo]) if rises else before
                group.sags.gets(servo, share, float(bent[servo]) * (1.0 / share - 1.0))
                if rises:
                    found[servo] = share
                if share == self._full[servo]:
                    del self._full[servo]
        return found

    def weights(self, position: Array) -> Array:
        """Angles (n_servos,) [rad] by which links bend joints of full stiffness below their references; 0
        where masses are unknown, or where friction or what a hand carries may bend it the other way."""
        if not self._weight.known:
            return np.zeros(len(position))
        bent = self._own(position)
        return np.where(np.abs(bent) > SOFT * FRICTION + self._loaded, bent, 0.0)

    def _bent(self, position: Array) -> Array:
        """Angles (n_servos,) [rad] by which weights bend joints of full stiffness."""
        bent: Array = np.abs(self._own(position)) + self._loaded
        return bent

    def _own(self, position: Array) -> Array:
        bent: Array = SOFT * self._weight.torques(position) / self._torque
        return bent


def _changed(group: Group, shares: Array, powered: NDArray[np.bool_] | None) -> dict[int, float]:
    """Those of the `shares` (k,), by servo, that differ from now, of servos with power."""
    on = np.ones(len(shares), bool)
    if powered is not None and len(powered) > group.servos.max():
        on = powered[group.servos]
    rows = zip(group.servos.tolist(), shares.tolist(), group.sags.shares.tolist(), on, strict=True)
    return {servo: share for servo, share, now, able in rows if share != now and able}
