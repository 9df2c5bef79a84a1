"""The protective withdrawal reflex (§4): a touched arm moves away from the touch.

1. Each contact asks for a motion: a blend of the base motions of all fields of the touched segment, by how
   directly each takes the touched place away. It grows with the force (eqs 5-7): `answer`.
2. The arm moves to its posture plus gain times base motion (eq. 5), once per touch: a touch lasts until the
   arm has been quiet for the refractory time (`withdrawal_rule`).
3. No motion presses skin into a touching object (`retreat`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.capabilities.answer import blend, field_table, find_answers, segments_of
from tci.capabilities.beside import SHORT, beside
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields, default_surround
from tci.capabilities.needs import Need
from tci.capabilities.on_own_skin import on_own_skin
from tci.capabilities.withdrawal_memory import RESPONSES, Response, Wish, Withdrawals
from tci.capabilities.withdrawal_rule import blind_field, new_targets, withdraw_all
from tci.errors import TciError
from tci.messages import (
    Command,
    Contact,
    Contacts,
    GenericCommand,
    Mode,
    ModeLike,
    Order,
    Perception,
    SwitchMode,
)
from tci.messages.frames import Array, read_only
from tci.reasons import Reason
from tci.robot.blow import PEOPLE, Struck, checked_people
from tci.robot.generic_arm import JOINTS, SEGMENTS

INITIAL = read_only(np.deg2rad([25.0, 25.0, 0.0, 60.0, 0.0]))
"""Generic angles (5,) [rad] of an arm whose posture isn't told: the packaged robots' initial posture."""
SHOULDER = 0.5
"""Place along an upper arm up to which the skin moves otherwise than on the generic arm: it is nearer to the
axes of the shoulder, which may not meet. On TIAGo it is 0.28; at 0.77 of Talos such an answer differs by 7.5
degrees from its neighbours'."""
MODES = (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)
"""Control modes in which the reflex can run."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Response to one contact."""

    name: str
    """Name of the field, or of the segment whose fields are blended."""
    motion: tuple[float, ...]
    """Full motion (5,) [rad]."""
    gain: float
    """The arm moves by this fraction of the full motion (eq. 5), above 0 and at most 1."""


WithdrawalMemory = Withdrawals[Response]
"""Withdrawals by generic part, and why other touched arms do not move."""


@dataclass(frozen=True)
class WithdrawalReflex(Capability[WithdrawalMemory]):
    """Moves every touched arm away from the touch, once per touch.

    Raises TciError for a setting out of range.
    """

    needs = (Need("skin on an arm", ("arm",), SEGMENTS),)
    fields: Sequence[ReceptiveField] = field(default_factory=default_fields)
    """Receptive fields of the paper's responses. The function `load_fields` reads other fields from a file.
    Without fields there is no reflex."""
    surround: Sequence[ReceptiveField] | None = None
    """Fields that the response "blended" mixes. If None, `default_surround` is used together with the default
    `fields`; other `fields` are then blended themselves."""
    refractory: float = 0.5
    """Refractory time [s]: if no touch has caused a response for this time, the arm can withdraw again.
    Assumed: a hand that slides or shakes makes contact again in less time."""
    response: Literal["blended", "meant", "printed"] = "blended"
    """"blended": continuous over the whole arm. "meant" and "printed": the nearest of `fields` that contains
    the contact answers by eqs 5-6, with parentheses as the text of the paper means them, or as they are
    printed."""
    mode: ModeLike = Mode.POSITION
    """Control mode of the arms. The target posture is equal in all three modes. In impedance mode the arms
    are soft: a touched arm first yields to the touch, and then withdraws."""
    approach: float = 0.08
    """Time constant [s] with which an arm in velocity mode approaches its target. Assumed: twice the
    longest control period of a driver, so that the loop stays stable."""
    softness: float = 0.4
    """Stiffness of the arms in impedance mode, relative to full stiffness. Assumed: soft enough to yield to a
    hand, stiff enough to reach the target against gravity."""
    people: Sequence[Struck] = PEOPLE
    """Who may stand in the way. Each withdrawal is so slow that none of them is struck harder than they say;
    empty for the robot's full speed."""
    _used: tuple[ReceptiveField, ...] = field(init=False, repr=False, compare=False)
    _table: NDArray[np.void] = field(init=False, repr=False, compare=False)
    _motions: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", tuple(self.fields))
        surround = self.surround
        if surround is None:
            measure = self.fields[0].measure if self.fields else "total"
            default = self.fields == default_fields(measure=measure)
            surround = default_surround(measure=measure) if default else self.fields
        object.__setattr__(self, "surround", tuple(surround) if self.fields else ())
        used = self.surround if self.response == "blended" else self.fields
        object.__setattr__(self, "_used", used)
        object.__setattr__(self, "_table", field_table(self._used))
        motions = np.reshape([one.motion for one in self._used], (-1, len(JOINTS)))
        object.__setattr__(self, "_motions", read_only(motions))
        mode = Mode.of(self.mode)
        object.__setattr__(self, "mode", mode)
        object.__setattr__(self, "people", checked_people("withdrawal", self.people))
        if not 0.0 < self.refractory < np.inf:
            raise TciError(f"withdrawal: refractory {self.refractory} s; valid: above 0 and finite")
        if self.response not in RESPONSES:
            raise TciError(f"withdrawal: response {self.response!r}; valid: {', '.join(RESPONSES)}")
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
        wishes = self._wishes(perception.contacts, perception.posture) if len(perception.contacts) else {}
        mode = Mode.of(self.mode)
        after = withdraw_all(
            memory, wishes, perception, body, refractory=self.refractory, mode=mode, people=self.people,
            others=partial(self._others, perception, body) if self.response == "blended" else None,
        )  # fmt: skip
        if mode is not Mode.VELOCITY:
            return new_targets(memory, after, mode), after
        velocities = {
            part: (one.target - perception.posture[part]) / self.approach for part, one in after.items()
        }
        return tuple(
            GenericCommand(part, Mode.VELOCITY, read_only(v), speed=after[part].pace.speed)
            for part, v in velocities.items()
        ), after

    def _wishes(self, contacts: Contacts, posture: Mapping[str, Array]) -> dict[str, list[Wish[Response]]]:
        """The responses that the contacts ask for, by part (eqs 5-7)."""
        count = len(contacts)
        sites = [contacts.sites[site] for site in contacts.site.tolist()]
        table = segments_of(sites), contacts.rows, contacts.begin, contacts.taxel_rows
        gains, found = np.empty(count), np.empty(count, np.int64)
        wishes: dict[str, list[Wish[Response]]] = {}
        if self.response == "blended":
            postures, blends = np.empty((count, len(JOINTS))), np.empty((count, len(JOINTS)))
            for row, site in enumerate(sites):
                angles = posture.get(site.part, INITIAL)
                postures[row] = angles if angles.size == len(JOINTS) else np.nan
            room = np.empty((max(len(self._table), 4), 3))
            blend(self._table, self._motions, *table, postures, room, blends, gains)
            motions = blends.tolist()
        else:
            find_answers(self._table, self.response == "printed", *table, found, gains)
        for contact, gain in enumerate(gains.tolist()):
            if gain > 0.0:
                site = sites[contact]
                if self.response == "blended":
                    response = Response(site.segment, tuple(motions[contact]))
                else:
                    field = self._used[found[contact]]
                    response = Response(field.name, field.motion)
                wishes.setdefault(site.part, []).append(Wish(response, gain, contact))
        return wishes

    def _others(
        self, perception: Perception, body: GenericBody, part: str, refused: Response, answers: Sequence[int]
    ) -> Iterator[list[Response]]:
        """Blends of the same fields in the place of a refused one: beside it, then, near shoulders and on
        arms that stand alone, those for their own skin. These differ more between neighbouring places."""
        motions, arm = (
            self._motions[[one.segment == refused.name for one in self._used]],
            body.robot.part(part),
        )
        asked, long = np.array(refused.motion), arm.segment(refused.name).length >= SHORT
        if long:
            yield _responses(refused.name, beside(asked, np.abs(motions).max(axis=0)))
        near = refused.name == "upper_arm" and all(perception.contacts[k].u < SHOULDER for k in answers)
        if arm.stands_alone or (long and near):
            for mixed in on_own_skin(
                perception, body, part, motions, answers, refused=asked, turns=not arm.stands_alone
            ):
                yield _responses(refused.name, mixed)

    def resume(
        self,
        memory: WithdrawalMemory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], WithdrawalMemory]:
        """An arm that comes back is felt anew: its last target was meant for where it was then."""
        back = {one.part for one in last if isinstance(one, Command)}
        motions = {part: one for part, one in memory.motions.items() if part not in back}
        kept = (one for one in last if not (isinstance(one, GenericCommand) and one.mode is self.mode))
        return tuple(kept), replace(memory, motions=motions)

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

    def answer(self, contact: Contact, posture: Mapping[str, Array] | None = None) -> Answer | None:
        """The response to one contact (eqs 5-7), None if there is none. `posture` are the generic angles
        [rad] by part, by default those of the initial posture."""
        return self.answers((contact,), posture)[0]

    def answers(
        self, contacts: Sequence[Contact], posture: Mapping[str, Array] | None = None
    ) -> list[Answer | None]:
        """The response to each contact as if it were the only one."""
        found: list[Answer | None] = [None] * len(contacts)
        for own in self._wishes(Contacts.of(contacts), posture or {}).values():
            for wish in own:
                found[wish.contact] = Answer(*wish.field, wish.gain)
        return found


def _responses(name: str, motions: Array) -> list[Response]:
    return [Response(name, tuple(row)) for row in motions.tolist()]
