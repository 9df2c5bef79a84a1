"""The protective withdrawal reflex (§4): a touched arm moves away from what touches it (eqs 5-7).

Once per touch, and never towards it: see `withdrawal_rule`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.answer import field_table, find_answers
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.capabilities.withdrawal_rule import Wish, Withdrawals, told, withdraw
from tci.errors import CommandError, TciError
from tci.frames import Array, read_only
from tci.messages import Command, Contact, GenericCommand, LimbPlace, Mode, Perception, SwitchMode
from tci.reasons import Code, Reason
from tci.robot.generic_arm import JOINTS
from tci.skin.contact_table import ContactTable

DISCOUNTS = ("linear", "cosine")
"""Distance discounts: `discounts.psi` and `psi_cosine`."""
MODES = (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)
"""Forms of the reflex."""
LEAST_COVERAGE = 0.5
"""Share of a field's taxels below which nobody should rely on it."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What one contact asks for."""

    field: ReceptiveField
    """The closest of the fields that it lies in."""
    gain: float
    """phi(F) psi(d), above 0 and at most 1 (eq. 5)."""


WithdrawalMemory = Withdrawals[ReceptiveField]
"""The withdrawal of each arm that has one, by generic part; and why touched arms stay."""


@dataclass(frozen=True)
class WithdrawalReflex(Capability[WithdrawalMemory]):
    """Moves every touched arm away from the touch, once per touch.

    Raises TciError for settings that make no reflex.
    """

    fields: Sequence[ReceptiveField] = field(default_factory=default_fields)
    """Receptive fields; `load_fields` reads others from a file. None: no reflex."""
    refractory: float = 0.5
    """How long [s] the skin of an arm must be quiet before it can withdraw again. Ours."""
    distance_discount: Literal["linear", "cosine"] = "linear"
    """Which psi of eq. 5: 1 - d / r, or cos^2(pi d / 2 r)."""
    mode: Mode = Mode.POSITION
    """Control mode of the arms: position, velocity (drives to the same target) or impedance (soft arms that
    yield to the touch at once, and withdraw to the same target)."""
    approach: float = 0.08
    """Time constant [s] with which an arm in velocity mode comes to its target. Ours."""
    softness: float = 0.4
    """Share of full stiffness that arms in impedance mode have. Ours."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", tuple(self.fields))
        object.__setattr__(self, "mode", Mode.of(self.mode))
        if not 0.0 < self.refractory < np.inf:
            raise TciError(f"refractory period {self.refractory} s; valid: above 0 and finite")
        if self.distance_discount not in DISCOUNTS:
            raise TciError(f"distance discount {self.distance_discount!r}; valid: {', '.join(DISCOUNTS)}")
        if self.mode not in MODES:
            valid = ", ".join(mode.value for mode in MODES)
            raise TciError(f"a withdrawal in {self.mode.value} mode; valid: {valid}")
        if not 0.0 < self.approach < np.inf:
            raise TciError(f"approach {self.approach} s; valid: above 0 and finite")
        if not 0.0 < self.softness <= 1.0:
            raise TciError(f"softness {self.softness}; valid: above 0, at most 1")

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        """The control mode of every arm, unless it is position."""
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
        """One command for each arm whose target changed, in velocity mode for each that is not there yet;
        what goes on on each arm.

        Raises CommandError when a touched part does not have the five joints of a base motion.
        """
        commands: list[Command] = []
        withdrawals = {}
        refused = memory.refused
        wishes = self._wishes(perception.contacts) if perception.contacts else {}
        for part, posture in perception.posture.items():
            before, own = memory.motions.get(part), wishes.get(part, ())
            if before is None and not own:
                continue
            if own and posture.size != len(own[0].field.motion):
                valid = len(own[0].field.motion)
                raise CommandError(f"{part} has {posture.size} joints; a base motion has {valid}")
            after, reason = withdraw(
                before, own, perception, body, part,
                refractory=self.refractory, refused=refused.get(part), mode=self.mode,
            )  # fmt: skip
            refused = told(refused, part, after, reason)
            if after is None:
                continue
            withdrawals[part] = after
            if self.mode is Mode.VELOCITY:
                velocity = (after.target - posture) / self.approach
                commands.append(GenericCommand(part=part, mode=Mode.VELOCITY, values=read_only(velocity)))
            elif not after.goes_as(before):
                commands.append(GenericCommand(part=part, mode=self.mode, values=after.target))
        return tuple(commands), Withdrawals(withdrawals, refused)

    def notes(self, memory: WithdrawalMemory) -> tuple[str, ...]:
        """Which arms stay though they were touched, and why."""
        return memory.notes

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns the field that has lost most of the skin that it feels with, as a reason to stop."""
        if perception.skin is None or perception.skin.masked is None:
            return None
        places = [LimbPlace(one.segment, one.u, one.theta) for one in self.fields]
        radii = np.array([one.radius for one in self.fields])
        for part in body.parts("arm"):
            shares = body.coverage(perception, part, places, radii).tolist()
            for place, share in zip(self.fields, shares, strict=True):
                if share >= LEAST_COVERAGE:
                    continue
                return Reason(
                    Code.SKIN_BLIND,
                    f"the field {place.name} of {part} is blind: {share:.0%} of its taxels can be trusted; "
                    f"valid: {LEAST_COVERAGE:.0%} or more",
                )
        return None

    def answer(self, contact: Contact) -> Answer | None:
        """The closest field's answer to one contact (eqs 5-7); None when there is none.

        The sum of overlapping fields would have no bound.
        """
        ((_, closest, gain),) = self._find(ContactTable.of((contact,)))
        return Answer(self.fields[closest], gain) if gain > 0.0 else None

    def _find(self, table: ContactTable) -> Iterable[tuple[int, int, float]]:
        """Of each row its patch, the field that is nearest, and the gain; 0: no answer."""
        closest, gains = np.empty(len(table), np.int64), np.empty(len(table))
        find_answers(
            self._table, self.distance_discount == "cosine", table.segments, table.patch, table.bounds,
            table.numbers, table.places, np.empty(len(self.fields)), closest, gains,
        )  # fmt: skip
        return zip(table.patch.tolist(), closest.tolist(), gains.tolist(), strict=True)

    def _wishes(self, contacts: Sequence[Contact]) -> dict[str, list[Wish[ReceptiveField]]]:
        """What each contact asks for that has an answer, by part."""
        table = ContactTable.of(contacts)
        places = np.argsort(table.order).tolist()
        wishes: dict[str, list[Wish[ReceptiveField]]] = {}
        for place, (patch, nearest, gain) in zip(places, self._find(table), strict=True):
            if gain > 0.0:
                wish = Wish(self.fields[nearest], gain, place)
                wishes.setdefault(table.sites[patch].part, []).append(wish)
        return wishes

    @cached_property
    def _table(self) -> Array:
        return field_table(self.fields)
