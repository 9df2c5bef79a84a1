"""The protective withdrawal reflex (§4): a touched arm moves away from the touch.

1. Each contact asks for the base motion of the receptive field that contains it, with a gain that grows with
   the force and falls with the distance from the field's centre (eqs 5-7): `answer`.
2. The arm moves to its posture plus gain times base motion (eq. 5), once per touch: a touch lasts until the
   arm has been quiet for the refractory time (`withdrawal_rule`).
3. No motion presses skin into a touching object (`retreat`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.capabilities.answer import RANKS, field_table, find_answers, segments_of
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields, default_surround
from tci.capabilities.needs import Need
from tci.capabilities.withdrawal_memory import Wish, Withdrawals
from tci.capabilities.withdrawal_rule import blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.messages import (
    Command,
    Contact,
    Contacts,
    GenericCommand,
    Mode,
    ModeLike,
    Perception,
    SwitchMode,
)
from tci.messages.frames import read_only
from tci.reasons import Reason
from tci.robot.generic_arm import JOINTS, SEGMENTS

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


WithdrawalMemory = Withdrawals[ReceptiveField]
"""Withdrawals by generic part, and why other touched arms do not move."""


@dataclass(frozen=True)
class WithdrawalReflex(Capability[WithdrawalMemory]):
    """Moves every touched arm away from the touch, once per touch.

    Raises TciError for a setting out of range.
    """

    needs = (Need("skin on an arm", ("arm",), SEGMENTS),)
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
    mode: ModeLike = Mode.POSITION
    """Control mode of the arms. The target posture is equal in all three modes. In impedance mode the arms
    are soft: a touched arm first yields to the touch, and then withdraws."""
    approach: float = 0.08
    """Time constant [s] with which an arm in velocity mode approaches its target. Assumed: twice the
    longest control period of a driver, so that the loop stays stable."""
    softness: float = 0.4
    """Stiffness of the arms in impedance mode, relative to full stiffness. Assumed: soft enough to yield to a
    hand, stiff enough to reach the target against gravity."""
    _tables: tuple[NDArray[np.void], NDArray[np.void]] = field(init=False, repr=False, compare=False)
    """`fields` and `surround` for the compiled loop."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", tuple(self.fields))
        surround = self.surround
        if surround is None:
            surround = default_surround() if self.fields == default_fields() else ()
        surround = tuple(surround) if self.fields else ()
        object.__setattr__(self, "surround", surround)
        object.__setattr__(self, "_tables", (field_table(self.fields), field_table(surround)))
        mode = Mode.of(self.mode)
        object.__setattr__(self, "mode", mode)
        if not 0.0 < self.refractory < np.inf:
            raise TciError(f"withdrawal: refractory {self.refractory} s; valid: above 0 and finite")
        if self.distance_discount not in DISCOUNTS:
            raise TciError(
                f"withdrawal: distance_discount {self.distance_discount!r}; valid: {', '.join(DISCOUNTS)}"
            )
        if mode not in MODES:
            valid = ", ".join(one.value for one in MODES)
            raise TciError(f"withdrawal: mode {mode.value}; valid: {valid}")
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
        """In position and impedance mode a command for each arm with a new target, in velocity mode one for
        each arm that withdraws.

        Raises CommandError if a touched part does not have the five joints of a base motion.
        """
        wishes = self._wishes(memory, perception.contacts) if len(perception.contacts) else {}
        mode = Mode.of(self.mode)
        after = withdraw_all(memory, wishes, perception, body, refractory=self.refractory, mode=mode)
        if mode is not Mode.VELOCITY:
            return new_targets(memory, after, mode), after
        velocities = {
            part: (one.target - perception.posture[part]) / self.approach for part, one in after.items()
        }
        return tuple(GenericCommand(p, Mode.VELOCITY, read_only(v)) for p, v in velocities.items()), after

    def _wishes(self, memory: WithdrawalMemory, contacts: Contacts) -> dict[str, list[Wish[ReceptiveField]]]:
        """The responses that the contacts ask for, by part, those with a lower rank first (eqs 5-7).

        Wide fields respond only on arms at rest, and on arms that a wide field moves.
        """
        surround = self.surround or ()
        nearest, gains = np.empty((RANKS, len(contacts)), np.int64), np.empty((RANKS, len(contacts)))
        cosine = self.distance_discount == "cosine"
        sites = [contacts.sites[site] for site in contacts.site.tolist()]
        table = segments_of(sites), contacts.rows, contacts.begin, contacts.taxel_rows
        find_answers(*self._tables, cosine, *table, nearest, gains)
        wide = [one.name for one in surround] if memory.motions else ()
        narrow = [part for part, one in memory.motions.items() if one.field.name not in wide]
        wishes: dict[str, list[Wish[ReceptiveField]]] = {}
        for rank, (own, found) in enumerate(zip(nearest.tolist(), gains.tolist(), strict=True)):
            fields = surround if rank else self.fields
            for contact, gain in enumerate(found):
                part = sites[contact].part
                if gain > 0.0 and not (rank and part in narrow):
                    wish = Wish(fields[own[contact]], gain, contact, rank)
                    wishes.setdefault(part, []).append(wish)
        return wishes

    def claims(self, memory: WithdrawalMemory) -> frozenset[str]:
        """The arms that withdraw, until `refractory` after their last touch."""
        return frozenset(memory)

    def notes(self, memory: WithdrawalMemory) -> tuple[str, ...]:
        """Returns a sentence for each touched arm that does not move, with the reason."""
        return memory.notes

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns a reason to stop the robot if more than half of the taxels of a receptive field are not
        trusted, otherwise None."""
        if perception.skin is None or perception.skin.masked is None:
            return None
        places = [one.place for one in self.fields]
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
        """The response to each contact as if it were the only one."""
        found: list[Answer | None] = [None] * len(contacts)
        for own in self._wishes(Withdrawals({}, {}), Contacts.of(contacts)).values():
            for wish in reversed(own):
                found[wish.contact] = Answer(wish.field, wish.gain)
        return found
