"""Withdrawal of head, torso, hands and legs (§4, beyond the arm): a touched part moves away.

The answer is a blend of base motions, as on the arms, by how directly each takes the touched place away. The
robot's own kinematics tell how directly, since these parts have no limb coordinates; so in eq. 5 ("meant" and
"printed") the distance d is measured along the skin. The force F is the sum over all taxels of a contact.

A leg that carries the robot must not move. Therefore a leg responds to touches only in two cases:

- The `stance` is "supported", and no sole measures the robot's weight.
- Other legs carry the robot: the soles of these legs measure the robot's weight, and the centre of mass would
  stay above these soles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.answer import LEAST, mix
from tci.capabilities.capability import Capability
from tci.capabilities.discounts import phi, printed, psi
from tci.capabilities.fields import BodyField, BodyFields, BodyMotion, default_body_fields
from tci.capabilities.needs import Need
from tci.capabilities.withdrawal_memory import RESPONSES, Response, Wish, Withdrawals
from tci.capabilities.withdrawal_rule import blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.messages import Contact, Contacts, Order, Perception
from tci.messages.frames import Array, read_only
from tci.reasons import Reason
from tci.robot.description import SOLE

ALONE = (
    "the robot stands on its legs; a leg moves only if stance is 'supported', or if the sole of another leg "
    "measures {weight:g} N or more and that leg carries the robot alone"
)
SLACK = 0.02
"""Speed [m/rad] of the touched place below which a motion loses its weight. Assumed: the slack of an arm
(`answer.SLACK`) on a limb of 0.2 m."""

M = TypeVar("M", bound=BodyMotion)
BodyMemory = Withdrawals[Response]
"""Current withdrawals by part, and the reasons for which other touched parts do not move."""


@dataclass(frozen=True)
class BodyWithdrawal(Capability[BodyMemory]):
    """Moves every touched head, torso, hand and leg away from the touch, once per touch.

    Raises TciError for a setting out of range. The defaults are assumed, since the paper (§4) describes a
    reflex of arms only.
    """

    needs = (Need("skin on a head, torso, hand or leg", ("head", "torso", "hand", "leg"), switches=False),)
    fields: BodyFields = field(default_factory=default_body_fields)
    """Receptive fields. The function `load_body_fields` reads other fields from a file."""
    refractory: float = 0.5
    """Refractory time [s]: if no touch has caused a response for this time, the part can withdraw again.
    Assumed: a hand that slides or shakes makes contact again in less time."""
    response: Literal["blended", "meant", "printed"] = "blended"
    """"blended": the motions of `fields.surround`, continuous over each part and segment. "meant" and
    "printed": the nearest field that contains the contact answers by eqs 5-6, with parentheses as the text of
    the paper means them, or as they are printed."""
    stance: Literal["standing", "supported"] = "standing"
    """`standing`: the legs carry the robot. `supported`: the robot hangs, sits or lies, so its legs carry no
    weight."""
    weight: float = 15.0
    """Smallest force [N] on a sole at which TCI assumes that the leg carries the robot, also if `stance` is
    "supported". Assumed: less than half the weight of the lightest robot, more than the force of a touch on a
    sole."""

    margin: float = 0.01
    """A leg of a standing robot may move only if the centre of mass stays inside the edge of the soles on the
    ground by at least this distance [m]. Assumed: larger than the error caused by wrong masses in a
    description."""

    def __post_init__(self) -> None:
        for name in ("refractory", "weight", "margin"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"body withdrawal: {name} {getattr(self, name)}; valid: above 0, finite")
        if self.stance not in ("standing", "supported"):
            raise TciError(f"body withdrawal: stance {self.stance!r}; valid: standing, supported")
        if self.response not in RESPONSES:
            raise TciError(f"body withdrawal: response {self.response!r}; valid: {', '.join(RESPONSES)}")

    def init(self, body: GenericBody) -> BodyMemory:
        for part in body.robot.parts:
            body.prepare(part.name, [one.landmark for one in self._own(part.name, body)])
        return Withdrawals({}, {})

    def step(
        self, memory: BodyMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], BodyMemory]:
        """Returns one command for each part whose target changed, and the current withdrawals."""
        whole, heavy = perception, self._heavy(perception.contacts)
        if heavy:  # while the robot stands, the contacts of its soles are with the ground
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

    def claims(self, memory: BodyMemory) -> frozenset[str]:
        """The parts that withdraw, until `refractory` after their last touch."""
        return frozenset(memory)

    def notes(self, memory: BodyMemory) -> tuple[str, ...]:
        """Returns a sentence for each touched part that does not move, with the reason."""
        return memory.notes

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns a reason to stop the robot if more than half of the taxels of a receptive field are not
        trusted, otherwise None."""
        if perception.skin is None or perception.skin.masked is None:
            return None
        for part in perception.posture:
            own = self._own(part, body)
            radii = np.array([one.radius_m for one in own])
            shares = body.coverage(perception, part, [one.landmark for one in own], radii)
            if blind := blind_field(part, own, shares):
                return blind
        return None

    def _own(self, part: str, body: GenericBody) -> list[BodyField]:
        """The fields of `part` whose base motion moves a joint of this robot."""
        return _of(part, self.fields.field, body)

    def _wishes(self, perception: Perception, body: GenericBody) -> dict[str, list[Wish[Response]]]:
        """The responses that the contacts ask for, by part."""
        wishes: dict[str, list[Wish[Response]]] = {}
        for index, touch in enumerate(perception.contacts):
            if touch.part not in perception.posture:
                continue
            if self.response == "blended":
                found = self._blended(touch, index, perception, body)
            else:
                found = self._nearest(touch, body)
            if found is not None and found[1] > 0.0:
                wishes.setdefault(touch.part, []).append(Wish(*found, index))
        return wishes

    def _nearest(self, touch: Contact, body: GenericBody) -> tuple[Response, float] | None:
        """The base motion of the field with the nearest centre that contains the contact, and its gain (eqs
        5-6)."""
        fields = [one for one in self._own(touch.part, body) if one.segment == touch.segment]
        apart = body.distances(touch, [one.landmark for one in fields])
        inside = [pair for pair in zip(apart, fields, strict=True) if pair[0] < pair[1].radius_m]
        if not inside:
            return None
        distance, found = min(inside, key=lambda pair: pair[0])
        range_n = self.fields.force.threshold_n, self.fields.force.saturation_n
        if self.response == "printed":
            gain = printed(touch.force, *range_n, distance, found.radius_m)
        else:
            gain = phi(touch.force, *range_n) * psi(distance, found.radius_m)
        return Response(found.name, found.motion), gain

    def _blended(
        self, touch: Contact, index: int, perception: Perception, body: GenericBody
    ) -> tuple[Response, float] | None:
        """The blend of the motions of the touched segment, and its gain; no motion where none takes the
        touched place away directly enough, None without any."""
        own = [*_of(touch.part, self.fields.surround or self.fields.field, body)]
        own = [one for one in own if one.segment == touch.segment]
        fields = [one for one in own if isinstance(one, BodyField)]
        near = np.ones(len(own))
        if fields:  # without a surround: fields of a user
            pairs = zip(body.distances(touch, [one.landmark for one in fields]), fields, strict=True)
            near = np.array([min(2.0 * psi(d, one.radius_m), 1.0) for d, one in pairs])
        if not near.any():
            return None
        motions = np.array([one.motion for one in own])
        here = perception.posture[touch.part]
        away, across = body.retreat_at_ends(perception, touch.part, here + motions)[:, :, index]
        slack = SLACK * np.linalg.norm(motions, axis=1)
        weights = near * np.maximum(away, 0.0) / np.sqrt(away * away + across * across + slack * slack)
        mixed = np.zeros(motions.shape[1])
        if weights.max() >= LEAST:
            mix(read_only(weights), read_only(motions), mixed)
        force = self.fields.force
        response = Response(touch.segment or touch.part, tuple(mixed.tolist()))
        return response, phi(touch.force, force.threshold_n, force.saturation_n)

    def _heavy(self, contacts: Sequence[Contact]) -> dict[str, float]:
        """Returns the force [N] on the soles of each leg that carries the robot, by name of the leg."""
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
        """Returns the reason why a leg must not move to generic angles `target` (n,) [rad]; empty if it may
        move.

        A leg may move if other legs carry the robot, or if the robot hangs, sits or lies. `heavy` is the
        force [N] on the soles of each leg that carries the robot.
        """
        if not heavy:
            return "" if self.stance == "supported" else ALONE.format(weight=self.weight)
        leg = part if part in heavy else max(heavy, key=lambda name: heavy[name])
        told = f"the sole of {leg} measures {heavy[leg]:.1f} N: {leg} carries the robot"
        if leg == part:
            return told
        margin = body.support(perception, part, target).margin
        if margin >= self.margin:
            return ""
        if not np.isfinite(margin):
            return told
        where = f"{abs(margin) * 1e3:.0f} mm {'inside' if margin >= 0.0 else 'outside'}"
        return (
            f"{told}, and its centre of mass would be {where} the edge of that sole; valid: "
            f"{self.margin * 1e3:g} mm inside or more"
        )


def _of(part: str, motions: Sequence[M], body: GenericBody) -> list[M]:
    """Those of the kind of `part`, for example of `leg` if the part is `left_leg`, that move a joint of this
    robot."""
    has = body.has_joint(part)
    own = [one for one in motions if part in body.parts(one.kind)]
    return [one for one in own if len(one.motion) == len(has) and np.any(one.motion * has)]
