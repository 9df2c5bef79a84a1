"""The rules of a withdrawal of any part: once per touch, and never towards the touching object.

A touch in a receptive field starts a *withdrawal* of the touched part. It lasts until no field of the part
has been touched for the refractory period; until then, all touches of the part count as one. The gain may
increase, at most to 1. No other motion begins, and none is added a second time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Generic, NamedTuple

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.pace import Pace
from tci.capabilities.retreat import LEAST, REACH, are_hopeless, hopeful, nowhere, why_not
from tci.capabilities.withdrawal_memory import F, Field, Refusal, Wish, Withdrawal, Withdrawals, target_of
from tci.errors import CommandError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.frames import Array, frozen
from tci.reasons import Code, Reason
from tci.robot.blow import PEOPLE, Struck

NO_WAY = "in this posture none of its joints takes the touched place away; valid: another posture"
NOWHERE = (
    f", but no other motion of its joints by up to {np.rad2deg(REACH):.0f} degrees leaves that object in "
    "this posture either: take another posture"
)
ROOM = 5e-3
"""Distance [m] that a withdrawal leaves to whoever it met: it ends before where the contact began."""
NOTICED = 0.03
"""Time [s] from the beginning of a contact until it is perceived: a frame of skin and a late reading."""
LEAST_COVERAGE = 0.5
"""A field is blind if the fraction of its healthy taxels is below this value: most touches of the field are
then missed."""
ENOUGH = 1.3
"""How much farther than `LEAST` a light touch's motion goes at its end, by the speed of a straight way: the
way is bent. Assumed."""
FIRM = 0.4
"""Least gain of a touch that is answered by more: of lighter ones the arm may wait for the rest of a poke."""
FARTHER = 0.35
"""By how much such a gain is larger at most: with more, the answers to places 13 mm apart differ by 6 degrees
in a joint of NAO's upper arm."""
TRIES = 40
"""Paths of other responses that are checked in the place of a refused one: each takes about 0.1 ms."""


def withdraw_all(
    memory: Withdrawals[F],
    wishes: Mapping[str, Sequence[Wish[F]]],
    perception: Perception,
    body: GenericBody,
    *,
    refractory: float,
    mode: Mode = Mode.POSITION,
    people: Sequence[Struck] = PEOPLE,
    forbids: Callable[[str, Array], str] | None = None,
    others: Callable[[str, F, Sequence[int]], Iterable[Sequence[F]]] | None = None,
) -> Withdrawals[F]:
    """The withdrawals of all parts after this instant.

    Args:
        memory: Withdrawals before this instant.
        wishes: Responses that the contacts ask for, by part.
        perception: Perception of this instant.
        body: The generic body.
        refractory: A touch ends when there has been no wish for its part for this time [s].
        mode: Control mode of the motions.
        people: Whoever may stand in the way, and how hard they may be struck.
        forbids: Further check. Receives a part and its target (n,) [rad], and returns the reason why the part
            must not move there; empty if it may.
        others: Receives a part, its refused response and the contacts that ask for it, and returns groups of
            those that may answer in its place, the nearest group first.

    Raises CommandError if a touched part has another number of joints than the base motion of its field.
    """
    if not memory.motions and not wishes:
        return memory
    now, motions, refused = perception.stamp, {}, dict(memory.refused)
    met = frozenset(perception.contacts.identity.tolist())
    for part in perception.posture:
        before, own = memory.motions.get(part), wishes.get(part, ())
        # Responses in successive steps count as one touch, even if the time between the steps is long.
        if before is not None and (before.quiet or not own) and now - before.touched >= refractory:
            before = None
        if not own and (before is None or (before.quiet and met <= before.met)):
            if before is not None:
                motions[part] = before
            continue
        touched = _Touched(part, own, perception, body, mode, met, others, people)
        after, refusal = touched.withdraw(before, refused.get(part))
        if own and after is not None and forbids is not None and (why := forbids(part, after.target)):
            refusal = touched.refusal(why, before)
            # The part has responded to this touch already: it goes on, but no farther.
            same = before is not None and before.started == after.started
            after = replace(after, gain=before.gain, target=before.target) if same and before else None
        if refusal is not None:
            refused[part] = refusal
        elif after is not None and not after.quiet and not after.ended:
            refused.pop(part, None)  # it moves again
        if after is not None:
            motions[part] = after
    return Withdrawals(motions, refused)


def new_targets(
    before: Withdrawals[F], after: Withdrawals[F], mode: Mode = Mode.POSITION
) -> tuple[GenericCommand, ...]:
    """A command for each part with a new target."""
    return tuple(
        GenericCommand(part, mode, one.target, speed=one.pace.speed)
        for part, one in after.motions.items()
        if not one.goes_as(before.motions.get(part))
    )


def blind_field(part: str, fields: Iterable[Field], shares: Array) -> Reason | None:
    """A reason to stop that names the first of the m `fields` whose fraction of healthy taxels, in `shares`
    (m,), is below LEAST_COVERAGE; None if there is none."""
    for one, share in zip(fields, shares.tolist(), strict=True):
        if share < LEAST_COVERAGE:
            return Reason(
                Code.SKIN_BLIND,
                f"the field {one.name} of {part} is blind: {share:.0%} of its taxels are healthy; "
                f"valid: {LEAST_COVERAGE:.0%} or more",
            )
    return None


class _Touched(NamedTuple, Generic[F]):
    """One part at one instant: all that decides whether it may move."""

    part: str
    wishes: Sequence[Wish[F]]
    perception: Perception
    body: GenericBody
    mode: Mode
    met: frozenset[int]
    """Identities of all present contacts."""
    others: Callable[[str, F, Sequence[int]], Iterable[Sequence[F]]] | None
    people: Sequence[Struck]

    def withdraw(
        self, before: Withdrawal[F] | None, refused: Refusal | None
    ) -> tuple[Withdrawal[F] | None, Refusal | None]:
        """The withdrawal after this instant, and the refusal if a wish is refused. `refused` is the last
        refusal of the part, which may still stand."""
        wishes = self.wishes
        if before is not None and not wishes:
            after, obstacle = self._meet(replace(before, quiet=True))
            return after, self.refusal(obstacle, before)
        if refused is not None and not refused.stands(before, wishes, self.perception):
            refused = None
        if before is None:
            if refused is not None:
                return None, refused
            begun, why = self._begin()
            return begun, self.refusal(why, before)
        after, why = replace(before, touched=self.perception.stamp, quiet=False), ""
        if not before.ended and refused is None:
            after, why = self._grow(after)
        after, obstacle = self._meet(after)
        return after, self.refusal(obstacle or why, before) or refused

    def refusal(self, reason: str, before: Withdrawal[F] | None) -> Refusal | None:
        return Refusal.of(reason, before, self.wishes, self.perception) if reason else None

    def _begin(self) -> tuple[Withdrawal[F] | None, str]:
        """The withdrawal for the first permitted wish, larger gains first. If none is permitted, None and why
        the first is refused (empty if the posture is unknown)."""
        origin, now, first = self.perception.posture[self.part], self.perception.stamp, ""
        if not all(map(isfinite, origin.tolist())):
            return None, ""
        if origin.size != (valid := len(self.wishes[0].field.motion)):
            raise CommandError(
                f"{self.part} has {origin.size} generic joints; valid: {valid}, as the base motions of its "
                "fields"
            )
        ways: dict[tuple[float, ...], list[Wish[F]]] = {}  # a motion is checked once for all its wishes
        for wish in sorted(self.wishes, key=_urgency, reverse=True):
            ways.setdefault(wish.field.motion, []).append(wish)
        hopeless = [False] * len(ways)
        for k, wishes in enumerate(ways.values()):
            if hopeless[k]:
                continue
            wish = wishes[0]
            target = target_of(origin, wish.gain, wish.field)
            moves = any(wish.field.motion)
            why = self._why_not(target, [one.contact for one in wishes]) if moves else NO_WAY
            if not why:
                pace = self._pace(target)
                return Withdrawal(wish.field, origin, wish.gain, target, now, now, self.met, pace=pace), ""
            if moves and not first and len(ways) > 1:
                hopeless = self._are_hopeless(origin, ways)
            first = first or why
        for wishes in ways.values():
            if (begun := self._farther(origin, wishes[0], [one.contact for one in wishes])) is not None:
                return begun, ""
            found = self._other(origin, wishes[0].gain, wishes[0].field, [one.contact for one in wishes])
            if found is not None:
                target = target_of(origin, wishes[0].gain, found)
                return Withdrawal(found, origin, wishes[0].gain, target, now, now, self.met), ""
        return None, self._nowhere(first)

    def _nowhere(self, why: str) -> str:
        """The reason of a refusal, which says it if no other motion of an arm would do either. Not of a touch
        that may still grow: to find out takes as long as the rest of its tick."""
        if self.others is None or max(wish.gain for wish in self.wishes) < 1.0:
            return why
        if not all(any(wish.field.motion) for wish in self.wishes):
            return why  # which says it
        answers = [wish.contact for wish in self.wishes]
        lost = nowhere(self.perception, self.body, self.part, answers)
        return why + NOWHERE if lost else why

    def _farther(self, origin: Array, wish: Wish[F], answers: Sequence[int]) -> Withdrawal[F] | None:
        """The withdrawal for a touch so light that its gain would not take the place `LEAST` away: with the
        gain that does, which is the same where the two meet. None if this is no better."""
        if not FIRM <= wish.gain < 1.0 or not any(wish.field.motion):
            return None
        end = np.array([target_of(origin, 1.0, wish.field)])
        away = self.body.retreat_at_ends(self.perception, self.part, end)[0, 0, answers].max()
        gain = min(ENOUGH * LEAST / max(away, ENOUGH * LEAST), wish.gain + FARTHER, 1.0)
        target = target_of(origin, gain, wish.field)
        if gain <= wish.gain or self._why_not(target, answers):
            return None
        now = self.perception.stamp
        return Withdrawal(wish.field, origin, gain, target, now, now, self.met, pace=self._pace(target))

    def _other(self, origin: Array, gain: float, field: F, answers: Sequence[int]) -> F | None:
        """The first permitted response in the place of a refused one; None if there is none."""
        if self.others is None or not any(field.motion):
            return None
        left = TRIES
        for others in self.others(self.part, field, answers):
            targets = origin + gain * np.reshape([other.motion for other in others], (-1, len(origin)))
            for k in hopeful(self.perception, self.body, self.part, targets, answers)[:left]:
                if not self._why_not(target_of(origin, gain, others[k]), answers):
                    return others[k]
                left -= 1
        return None

    def _grow(self, withdrawal: Withdrawal[F]) -> tuple[Withdrawal[F], str]:
        """The withdrawal with the gain of a stronger touch of its field, or why it must not go so far."""
        field, gain = withdrawal.field, withdrawal.gain
        more = [wish.gain for wish in self.wishes if wish.gain > gain and wish.field.name == field.name]
        if not more:
            return withdrawal, ""
        target = target_of(withdrawal.origin, max(more), field)
        if why := self._why_not(target):
            return withdrawal, why
        return replace(withdrawal, gain=max(more), target=target, pace=self._pace(target)), ""

    def _meet(self, withdrawal: Withdrawal[F]) -> tuple[Withdrawal[F], str]:
        """Ends a withdrawal, and says why, if the rest of it would press skin into an object that has touched
        since it was checked: the part goes back a little, and stays there."""
        if withdrawal.ended or self.met <= withdrawal.met:
            return withdrawal, ""
        if why := self._why_not(withdrawal.target):
            return replace(withdrawal, target=self._before(withdrawal), ended=True), why
        return replace(withdrawal, met=self.met), ""

    def _before(self, withdrawal: Withdrawal[F]) -> Array:
        """The posture on the way back to the origin at which the newly touched places are `ROOM` before where
        their contacts began, or as near to it as the older contacts permit; here, if it leads nowhere."""
        here = self.perception.posture[self.part]
        if self.perception.joints is None:
            return here
        new = [one.identity not in withdrawal.met for one in self.perception.contacts]
        back = here + np.linspace(0.0, 1.0, 21)[:, None] * (withdrawal.origin - here)
        since = here - NOTICED * self.body.rate(self.perception, self.part)
        away = self.body.retreat_at_ends(self.perception, self.part, np.vstack([since, back]))[0]
        travelled, away = np.maximum(away[0, new], 0.0), away[1:]
        permitted = (away[:, ~np.array(new)] >= -ROOM).all(axis=1).cumprod().astype(bool)
        least = np.where(permitted, (away[:, new] - travelled).min(axis=1), -np.inf)
        enough = least >= ROOM
        return frozen(back[int(enough.argmax() if enough.any() else least.argmax())])

    def _why_not(self, target: Array, answers: Sequence[int] = ()) -> str:
        return why_not(self.perception, self.body, self.part, target, mode=self.mode, answers=answers)

    def _pace(self, target: Array) -> Pace:
        return self.body.pace(self.perception, self.part, target, self.people)

    def _are_hopeless(self, origin: Array, ways: Mapping[tuple[float, ...], Sequence[Wish[F]]]) -> list[bool]:
        """True for each way that the posture at its end rules out: this needs less time than whole paths."""
        gains = np.array([wishes[0].gain for wishes in ways.values()])
        contacts = [[wish.contact for wish in wishes] for wishes in ways.values()]
        targets = origin + gains[:, None] * np.array([*ways])
        return are_hopeless(self.perception, self.body, self.part, targets, contacts)


def _urgency(wish: Wish[F]) -> tuple[float, str, tuple[float, ...]]:
    # Equal gains are sorted, so that the result does not depend on the order of contacts.
    return wish.gain, wish.field.name, wish.field.motion
