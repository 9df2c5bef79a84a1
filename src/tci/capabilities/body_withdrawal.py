"""Withdrawal of head, torso, hands and legs (§4, beyond the arm): what is touched moves away (eqs 5-6).

The distance in eq. 5 is along the skin, since these parts are no limbs, and the force is that of all taxels
of a contact. A leg that carries the robot must not give way: legs answer only when somebody says that the
robot is supported and no sole feels its weight, or when the other legs carry it: their soles feel its
weight, and its centre of mass would stay above them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.body_fields import BodyField, BodyFields, default_body_fields
from tci.capabilities.capability import Capability
from tci.capabilities.discounts import phi, psi
from tci.capabilities.withdrawal_rule import Wish, Withdrawals, blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.frames import Array
from tci.messages import Contact, Contacts, Order, Perception
from tci.reasons import Reason
from tci.robot.description import SOLE

ALONE = (
    "the robot stands: a leg answers only where stance is supported, or where another leg's sole feels "
    "{weight:g} N and carries it alone"
)


BodyMemory = Withdrawals[BodyField]
"""The withdrawal of each part that has one, by name; and why touched parts stay."""


@dataclass(frozen=True)
class BodyWithdrawal(Capability[BodyMemory]):
    """Moves every touched head, torso, hand and leg away from the touch, once per touch.

    Raises TciError for settings that make no reflex. Defaults are ours.
    """

    fields: BodyFields = field(default_factory=default_body_fields)
    """Receptive fields; `load_body_fields` reads others from a file."""
    refractory: float = 0.5
    """How long [s] the skin of a part must be quiet before it can withdraw again."""
    stance: Literal["standing", "supported"] = "standing"
    """Whether the robot stands on its legs, or hangs, sits or lies, so that they carry nothing."""
    weight: float = 15.0
    """Force [N] under the sole of a leg from which it carries the robot, whatever `stance` says; a touch that
    the sole withdraws from is lighter."""

    margin: float = 0.01
    """How far [m] inside the soles that stay the centre of mass must be for a leg of a standing robot to
    answer."""

    def __post_init__(self) -> None:
        for name in ("refractory", "weight", "margin"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"body withdrawal: {name} {getattr(self, name)}; valid: above 0, finite")
        if self.stance not in ("standing", "supported"):
            raise TciError(f"body withdrawal: stance {self.stance!r}; valid: standing, supported")

    def init(self, body: GenericBody) -> BodyMemory:
        for part in body.robot.parts:
            body.prepare(part.name, [one.spot for one in self._own(part.name, body)])
        return Withdrawals({}, {})

    def step(
        self, memory: BodyMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], BodyMemory]:
        """One command for each part whose target changed."""
        whole, heavy = perception, self._heavy(perception.contacts)
        if heavy:  # what a sole feels while the robot stands is the ground
            contacts = Contacts.of(touch for touch in perception.contacts if touch.segment != SOLE)
            perception = replace(perception, contacts=contacts)

        def forbids(part: str, target: Array) -> str:
            legs = body.parts("leg")
            return self._carries(part, target, heavy, whole, body) if part in legs else ""

        after = withdraw_all(
            memory, self._wishes(perception, body), perception, body,
            refractory=self.refractory, forbids=forbids,
        )  # fmt: skip
        return new_targets(memory, after), after

    def notes(self, memory: BodyMemory) -> tuple[str, ...]:
        """Which parts stay though they were touched, and why."""
        return memory.notes

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns the field that has lost most of the skin that it feels with, as a reason to stop."""
        if perception.skin is None or perception.skin.masked is None:
            return None
        for part in perception.posture:
            own = self._own(part, body)
            radii = np.array([one.radius_m for one in own])
            shares = body.coverage(perception, part, [one.spot for one in own], radii)
            if blind := blind_field(part, own, shares):
                return blind
        return None

    def _own(self, part: str, body: GenericBody) -> list[BodyField]:
        """Fields of a part's kind for whose motion this robot has a joint."""
        has = body.has_joint(part)
        own = [one for one in self.fields.field if part in body.parts(one.kind)]
        return [one for one in own if len(one.motion) == len(has) and np.any(one.motion * has)]

    def _wishes(self, perception: Perception, body: GenericBody) -> dict[str, list[Wish[BodyField]]]:
        """Returns, by part, the closest field that each touch lies in, and its gain."""
        wishes: dict[str, list[Wish[BodyField]]] = {}
        for index, touch in enumerate(perception.contacts):
            if touch.part not in perception.posture:
                continue
            closest: tuple[float, BodyField] | None = None
            for candidate in self._own(touch.part, body):
                if candidate.segment != touch.segment:
                    continue
                distance = body.distance(touch, candidate.spot)
                if distance < candidate.radius_m and (closest is None or distance < closest[0]):
                    closest = distance, candidate
            if closest is None:
                continue
            distance, found = closest
            force = self.fields.force
            gain = phi(touch.force, force.threshold_n, force.saturation_n) * psi(distance, found.radius_m)
            if gain > 0.0:
                wishes.setdefault(touch.part, []).append(Wish(found, gain, index))
        return wishes

    def _heavy(self, contacts: Sequence[Contact]) -> dict[str, float]:
        """Legs on which the robot stands, and what their soles feel [N]."""
        felt: dict[str, float] = {}
        for contact in contacts:
            if contact.segment == SOLE:
                felt[contact.part] = felt.get(contact.part, 0.0) + contact.force
        return {leg: force for leg, force in felt.items() if force >= self.weight}

    def _carries(
        self,
        part: str,
        target: Array,
        heavy: Mapping[str, float],
        perception: Perception,
        body: GenericBody,
    ) -> str:
        """Why a leg must not go to generic angles (n,) [rad]; empty when it may: where nothing stands on a
        leg, or the other legs carry the robot."""
        if not heavy:
            return "" if self.stance == "supported" else ALONE.format(weight=self.weight)
        leg = part if part in heavy else max(heavy, key=lambda name: heavy[name])
        told = f"the sole of {leg} feels {heavy[leg]:.1f} N: it carries the robot"
        if leg == part:
            return told
        margin = body.support(perception, part, target).margin
        if margin >= self.margin:
            return ""
        if not np.isfinite(margin):
            return told
        where = f"{abs(margin) * 1e3:.0f} mm {'inside' if margin >= 0.0 else 'outside'}"
        return f"{told}, whose centre of mass would be {where} of it; valid: {self.margin * 1e3:g} mm inside"
