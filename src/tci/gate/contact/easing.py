"""A part that presses somebody while its encoders or servos are not what they seem: no way back is known, so
it presses as softly as gravity permits. When it is commanded again it gets its stiffness back, slowly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet

import numpy as np
from numpy.typing import NDArray

from tci.gate.contact.group import Group
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.weights import FRICTION, MOST, SOFT, bends
from tci.messages import Contact
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool

LEAST = 0.1
"""Share of the stiffness that is left at least: dry friction holds a joint with half of it."""
MORE, EVERY = 0.05, 0.1
"""Share of the stiffness that comes back at once, and time [s] between two: a joint that hangs 4 degrees low
rises in 2 s, so slowly that somebody above it is noticed first."""


class Easing:
    """Knows which share of its stiffness holds a part's weight. Without masses it keeps the whole."""

    def __init__(self, robot: Robot, weight: OwnWeight) -> None:
        self._torque = np.array([servo.limits.torque or np.nan for servo in robot.servos])
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
        most: float,
        position: Array,
        powered: NDArray[np.bool_] | None,
        now: float,
    ) -> tuple[dict[int, float], list[Reason]]:
        """Shares (0..1) of stiffness by servo, and what to tell, of each group that still answers a contact,
        or whose skin feels more than `most` [N]; each once.

        Args:
            groups: by number.
            contacts: of all skin.
            most: see above.
            position: where the robot was last seen (n_servos,) [rad].
            powered: see `shares`.
            now: time [s].
        """
        shares, told = dict[int, float](), list[Reason]()
        for number, group in groups.items():
            felt = max((one.force for one in contacts if one.part in group.parts), default=0.0)
            answers = (group.goal is not None and group.free is None) or group.noticing.sure
            if number in self._eased or group.waist or not (answers or felt > most):
                continue  # a soft waist lets the robot fall
            self._eased.add(number)
            if found := self.shares(group, position, powered):
                shares |= found
                before = zip(group.servos.tolist(), group.sags.shares.tolist(), strict=True)
                self._full = {servo: share for servo, share in before if servo in found} | self._full
                group.sags.told(np.array([*found]), np.array([*found.values()]), now)
                words = f"no way back is known for {group.name}, which presses somebody"
                least = f"{min(found.values()):.0%} to {max(found.values()):.0%}"
                told.append(Reason(Code.CONTACT, f"{words}: its stiffness falls to {least}"))
        return shares, told

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
        least = np.clip(self._bent(position) / MOST, LEAST, 1.0)[group.servos]
        on = np.ones(len(position), bool)
        if powered is not None and powered.shape == on.shape:
            on = powered
        rows = zip(group.servos.tolist(), least.tolist(), group.sags.shares.tolist(), strict=True)
        return {servo: share for servo, share, now in rows if share < now and on[servo]}

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
