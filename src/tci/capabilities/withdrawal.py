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
from tci.capabilities.answer import field_table, find_answers, segments_of, touches
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.capabilities.withdrawal_rule import Wish, Withdrawals, blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.frames import Array, read_only
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
from tci.reasons import Reason
from tci.robot.generic_arm import JOINTS

DISCOUNTS = ("linear", "cosine")
"""Distance discounts: `discounts.psi` and `psi_cosine`."""
MODES = (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)
"""Forms of the reflex."""


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
        wishes = self._wishes(perception.contacts) if perception.contacts else {}
        after = withdraw_all(memory, wishes, perception, body, refractory=self.refractory, mode=self.mode)
        if self.mode is not Mode.VELOCITY:
            return new_targets(memory, after, self.mode), after
        velocities = {
            part: (one.target - perception.posture[part]) / self.approach for part, one in after.items()
        }
        return tuple(GenericCommand(p, Mode.VELOCITY, read_only(v)) for p, v in velocities.items()), after

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
            if blind := blind_field(part, self.fields, body.coverage(perception, part, places, radii)):
                return blind
        return None

    def answer(self, contact: Contact) -> Answer | None:
        """The closest field's answer to one contact (eqs 5-7); None when there is none.

        The sum of overlapping fields would have no bound.
        """
        ((_, closest, gain),) = self._find(Contacts.of((contact,)))
        return Answer(self.fields[closest], gain) if gain > 0.0 else None

    def _find(self, table: Contacts) -> Iterable[tuple[int, int, float]]:
        """Of each contact its site, the field that is nearest, and the gain; 0: no answer."""
        closest, gains = np.empty(len(table), np.int64), np.empty(len(table))
        find_answers(
            self._table, self.distance_discount == "cosine", segments_of(table.sites), touches(table),
            np.empty(len(self.fields)), closest, gains,
        )  # fmt: skip
        return zip(table.site.tolist(), closest.tolist(), gains.tolist(), strict=True)

    def _wishes(self, contacts: Contacts) -> dict[str, list[Wish[ReceptiveField]]]:
        """Answers that contacts ask for, by part."""
        wishes: dict[str, list[Wish[ReceptiveField]]] = {}
        for row, (site, nearest, gain) in enumerate(self._find(contacts)):
            if gain > 0.0:
                wishes.setdefault(contacts.sites[site].part, []).append(Wish(self.fields[nearest], gain, row))
        return wishes

    @cached_property
    def _table(self) -> Array:
        return field_table(self.fields)
