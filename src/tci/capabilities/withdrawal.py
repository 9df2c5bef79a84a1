"""The protective withdrawal reflex (§4): a touched arm moves away from the touch (eqs 5-7).

The arm moves once per touch and never towards the object: see `withdrawal_rule`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.answer import SiteNumbers, field_table, find_answers, site_numbers, touches
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields, default_surround
from tci.capabilities.withdrawal_memory import Wish, Withdrawals
from tci.capabilities.withdrawal_rule import blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.messages import (
    Command,
    Contact,
    Contacts,
    GenericCommand,
    LimbPlace,
    Mode,
    Perception,
    SwitchMode,
)
from tci.messages.frames import Array, read_only
from tci.reasons import Reason
from tci.robot.generic_arm import JOINTS
from tci.support.compiled import entry

_find_answers = entry(find_answers)
DISCOUNTS = ("linear", "cosine")
"""Valid values of the setting `distance_discount`."""
MODES = (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)
"""Control modes in which the reflex can run."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Response to one contact."""

    field: ReceptiveField
    """Receptive field that responds: of all fields that contain the contact, the one with the closest
    centre."""
    gain: float
    """Gain phi(F) psi(d) of the response (eq. 5), above 0 and at most 1."""


_WishInputs = tuple[Contacts, frozenset[str], frozenset[str]]
"""All values from which requested responses (wishes) are computed: the contacts, the names of the parts on
which all contacts in one field count as one, and the names of the touched arms for which the wide fields
`surround` may respond."""
WithdrawalMemory = Withdrawals[ReceptiveField]
"""Current withdrawals by generic part, and the reasons for which other touched arms do not move."""


@dataclass(frozen=True)
class WithdrawalReflex(Capability[WithdrawalMemory]):
    """Moves every touched arm away from the touch, once per touch.

    Raises TciError for a setting out of range.
    """

    fields: Sequence[ReceptiveField] = field(default_factory=default_fields)
    """Receptive fields. The function `load_fields` reads other fields from a file. Without fields there is no
    reflex."""
    surround: Sequence[ReceptiveField] | None = None
    """Wide fields, used if none of `fields` responds, or if the motion of the responding field is not
    permitted. The wide field with the closest centre is tried first, then the second closest. If None,
    `default_surround` is used together with the default `fields`. With other `fields`, None means that there
    are no wide fields."""
    refractory: float = 0.5
    """Refractory time [s]: if no touch has caused a response for this time, the arm can withdraw again.
    Assumed: a hand that slides or shakes makes contact again in less time."""
    distance_discount: Literal["linear", "cosine"] = "linear"
    """Form of psi in eq. 5: 1 - d / r, or cos^2(pi d / 2 r), with the distance d from the field's centre and
    the field's radius r."""
    mode: Mode = Mode.POSITION
    """Control mode of the arms. The target posture is equal in all three modes. In impedance mode the arms
    are soft: a touched arm first yields to the touch, and then withdraws."""
    approach: float = 0.08
    """Time constant [s] with which an arm in velocity mode approaches its target. Assumed: twice the
    longest control period of a driver, so that the loop stays stable."""
    softness: float = 0.4
    """Stiffness of the arms in impedance mode, relative to full stiffness. Assumed: soft enough to yield to a
    hand, stiff enough to reach the target against gravity."""
    _latest: tuple[_WishInputs | None, dict[str, list[Wish[ReceptiveField]]]] = field(
        default=(None, {}), init=False, repr=False, compare=False
    )
    """Requested responses (wishes) that were computed last, after the values from which they were computed
    (None at first)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", tuple(self.fields))
        surround = self.surround
        if surround is None:
            surround = default_surround() if self.fields == default_fields() else ()
        object.__setattr__(self, "surround", tuple(surround) if self.fields else ())
        object.__setattr__(self, "mode", Mode.of(self.mode))
        if not 0.0 < self.refractory < np.inf:
            raise TciError(f"withdrawal: refractory {self.refractory} s; valid: above 0 and finite")
        if self.distance_discount not in DISCOUNTS:
            raise TciError(
                f"withdrawal: distance_discount {self.distance_discount!r}; valid: {', '.join(DISCOUNTS)}"
            )
        if self.mode not in MODES:
            valid = ", ".join(mode.value for mode in MODES)
            raise TciError(f"withdrawal: mode {self.mode.value}; valid: {valid}")
        if not 0.0 < self.approach < np.inf:
            raise TciError(f"withdrawal: approach {self.approach} s; valid: above 0 and finite")
        if not 0.0 < self.softness <= 1.0:
            raise TciError(f"withdrawal: softness {self.softness}; valid: above 0, at most 1")

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        """Returns the orders that set the control mode, and the stiffness in impedance mode, of every arm.

        There are no orders in position mode.
        """
        if self.mode is Mode.POSITION:
            return ()
        commands: list[Command] = []
        for part in body.parts("arm"):
            commands.append(SwitchMode(part, self.mode))
            if self.mode is Mode.IMPEDANCE:
                share = read_only(np.full(len(JOINTS), self.softness))
                commands.append(GenericCommand(part, Mode.STIFFNESS, share))
        return tuple(commands)

    def init(self, body: GenericBody) -> WithdrawalMemory:
        return Withdrawals({}, {})

    def step(
        self, memory: WithdrawalMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], WithdrawalMemory]:
        """Returns the commands and the current withdrawals.

        In position and impedance mode there is one command for each arm with a new target. In velocity mode
        there is one command for each arm that withdraws. Raises CommandError if a touched part does not have
        the five joints of a base motion.
        """
        contacts = perception.contacts
        wishes: dict[str, list[Wish[ReceptiveField]]] = {}
        if len(contacts):
            # A moving part responds to the strongest touch of each field. Weaker touches have no effect.
            moving = frozenset([part for part, one in memory.motions.items() if not one.quiet])
            numbers = site_numbers(contacts.sites, moving)
            inputs = contacts, moving, self._asking(memory, contacts, numbers)
            # Skin frames arrive less often than steps are taken, so the contacts are often those of the
            # previous step.
            if inputs != (latest := self._latest)[0]:
                latest = inputs, self._wishes(contacts, numbers, inputs[2])
                object.__setattr__(self, "_latest", latest)
            wishes = latest[1]
        after = withdraw_all(memory, wishes, perception, body, refractory=self.refractory, mode=self.mode)
        if self.mode is not Mode.VELOCITY:
            return new_targets(memory, after, self.mode), after
        velocities = {
            part: (one.target - perception.posture[part]) / self.approach for part, one in after.items()
        }
        return tuple(GenericCommand(p, Mode.VELOCITY, read_only(v)) for p, v in velocities.items()), after

    def notes(self, memory: WithdrawalMemory) -> tuple[str, ...]:
        """Returns a sentence for each touched arm that does not move, with the reason."""
        return memory.notes

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns a reason to stop the robot if more than half of the taxels of a receptive field are not
        trusted, otherwise None."""
        if perception.skin is None or perception.skin.masked is None:
            return None
        places = [LimbPlace(one.segment, one.u, one.theta) for one in self.fields]
        radii = np.array([one.radius for one in self.fields])
        for part in body.parts("arm"):
            if blind := blind_field(part, self.fields, body.coverage(perception, part, places, radii)):
                return blind
        return None

    def answer(self, contact: Contact) -> Answer | None:
        """Returns the response to one contact (eqs 5-7), or None if no field responds.

        Of all `fields` that contain the contact, the field with the closest centre responds. If there is no
        such field, the closest field of `surround` that contains the contact responds. Only one field
        responds, since the sum of the responses of overlapping fields would not be bounded.
        """
        return self.answers((contact,))[0]

    def answers(self, contacts: Sequence[Contact]) -> list[Answer | None]:
        """Returns the response to each contact. The response is computed as if there were no other
        contact."""
        table = Contacts.of(contacts)
        numbers = site_numbers(table.sites)
        wishes = self._wishes(table, numbers, around=numbers.limbs)
        found: list[Answer | None] = [None] * len(contacts)
        for wish in (one for part in wishes.values() for one in reversed(part)):
            found[wish.contact] = Answer(wish.field, wish.gain)
        return found

    def _asking(self, memory: WithdrawalMemory, contacts: Contacts, numbers: SiteNumbers) -> frozenset[str]:
        """Returns the names of the touched arms for which the wide fields `surround` may respond: the arms at
        rest, and the arms that a wide field already moves.

        `numbers` contains the part and the segment of each patch.
        """
        own = memory.motions
        asking = [p for p in numbers.limbs if p not in own or own[p].field.name in self._around]
        if not asking:
            return frozenset()
        return frozenset([numbers.part[site] for site in {*contacts.site.tolist()}]).intersection(asking)

    @cached_property
    def _around(self) -> frozenset[str]:
        return frozenset(field.name for field in self.surround or ())

    def _wishes(
        self, contacts: Contacts, numbers: SiteNumbers, around: Collection[str]
    ) -> dict[str, list[Wish[ReceptiveField]]]:
        """Returns the requested responses (wishes) by part.

        Each contact requests the response of the field that contains it; if several do, of the one with the
        closest centre. On the parts `around`, a contact also requests the responses of the two closest wide
        fields (`surround`) that contain it, which are tried later. `numbers` contains the part and the
        segment of each patch.
        """
        wishes: dict[str, list[Wish[ReceptiveField]]] = {}
        felt, parts, count = touches(contacts), numbers.part, len(contacts)
        cosine = self.distance_discount == "cosine"
        for ranks, fields, table in self._tables if around else self._tables[:1]:
            closest = np.empty(count, np.int64)
            closest.fill(-1)
            for rank in ranks:
                beside, closest, gains = closest, np.empty(count, np.int64), np.empty(count)
                _find_answers(
                    table, cosine, numbers.segment, numbers.merged, felt, beside, np.empty(len(fields)),
                    closest, gains,
                )  # fmt: skip
                for row in gains.nonzero()[0].tolist():
                    part = parts[contacts.site[row]]
                    if not rank or part in around:
                        wish = Wish(fields[closest[row]], float(gains[row]), row, rank)
                        wishes.setdefault(part, []).append(wish)
        return wishes

    @cached_property
    def _tables(self) -> list[tuple[tuple[int, ...], Sequence[ReceptiveField], Array]]:
        """Returns the groups of receptive fields for a compiled loop: `fields`, then the wide fields
        `surround`. An empty group is left out.

        A group consists of ranks, fields, and the fields as a table of numbers. The lower the rank of a
        response, the earlier it is tried: 0 for `fields`, 1 and 2 for the two closest wide fields.
        """
        sets = ((0,), self.fields), ((1, 2), self.surround or ())
        return [(ranks, fields, field_table(fields)) for ranks, fields in sets if fields]
