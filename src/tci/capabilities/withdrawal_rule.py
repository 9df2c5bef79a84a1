"""The rules of a withdrawal, of whatever part: once per touch, and never towards what touches.

A touch that answers in a field starts a *withdrawal* of its part. Until the part's skin has been quiet
for the refractory period, every touch of it counts as the same one: the gain may still grow, at most
to 1, but no other field answers and nothing is added twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.retreat import why_not
from tci.errors import CommandError
from tci.frames import Array, frozen
from tci.messages import GenericCommand, Mode, Perception
from tci.reasons import Code, Reason

ANEW = 0.02
"""Time [s] after which a refusal is judged anew though the skin feels as before: the robot may have moved."""

LEAST_COVERAGE = 0.5
"""Fraction of a field's taxels below which it must not be relied on. Assumed: more is felt than lost."""


class Field(Protocol):
    """A receptive field with its base motion."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def motion(self) -> tuple[float, ...]:
        """Theta_i [rad] of every generic joint."""


F = TypeVar("F", bound=Field)


class Wish(NamedTuple, Generic[F]):
    """The answer that one contact asks for."""

    field: F
    """The closest of the fields that it lies in."""
    gain: float
    """phi(F) psi(d), above 0 and at most 1 (eq. 5)."""
    contact: int
    """Its place in `Perception.contacts`."""


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawal(Generic[F]):
    """One part that withdraws."""

    field: F
    """Field that started it."""
    origin: Array
    """Generic posture (n,) [rad] when it started."""
    gain: float
    """Largest gain so far."""
    started: float
    """When it started [s]."""
    touched: float
    """When a touch of this part last answered [s]."""
    quiet: bool = False
    """True if a step without an answer has come since."""
    met: frozenset[int] = frozenset()
    """Identities of the contacts that it is known not to press: those of the latest look."""
    ended: Array | None = None
    """Generic posture (n,) [rad] where something came into its way; None: nothing did."""

    @property
    def target(self) -> Array:
        """Target of the part (n,) [rad]: one gain for all joints keeps the direction of Theta_i."""
        if self.ended is not None:
            return self.ended
        return frozen(self.origin + self.gain * np.array(self.field.motion))

    def goes_as(self, before: Withdrawal[F] | None) -> bool:
        """Whether it goes where it went `before`."""
        if before is None or before.ended is not self.ended:
            return False
        return (before.started, before.gain) == (self.started, self.gain)


class Refusal(NamedTuple):
    """The reason why a touched part stays. A touch that lasts is not judged anew in each period."""

    reason: str
    frames: bytes
    """Sequences of the skin frames that it was judged by."""
    stamp: float
    """Time of that [s]."""

    def stands(self, perception: Perception) -> bool:
        """Tells if it need not be judged anew: no skin frame has come since, and it is recent."""
        return perception.stamp - self.stamp < ANEW and _frames(perception) == self.frames


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawals(Mapping[str, Withdrawal[F]]):
    """Withdrawals under way, by part, and the reasons why other parts stay."""

    motions: Mapping[str, Withdrawal[F]]
    refused: Mapping[str, Refusal]
    """Reasons why touched parts stay, by name, for the latest touch."""

    def __getitem__(self, part: str) -> Withdrawal[F]:
        return self.motions[part]

    def __iter__(self) -> Iterator[str]:
        return iter(self.motions)

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def notes(self) -> tuple[str, ...]:
        """Messages to a person about parts that stay."""
        return tuple(f"{part} was touched and stays: {one.reason}" for part, one in self.refused.items())


def withdraw_all(
    memory: Withdrawals[F],
    wishes: Mapping[str, Sequence[Wish[F]]],
    perception: Perception,
    body: GenericBody,
    *,
    refractory: float,
    mode: Mode = Mode.POSITION,
    forbids: Callable[[str, Array], str] | None = None,
) -> Withdrawals[F]:
    """Returns the withdrawals of all parts after this instant; `wishes` are those of each touched part.

    `forbids` tells why a part must not go to generic angles (n,) for a reason of its own; empty if it may.
    Raises CommandError for a touched part that has not as many joints as a base motion.
    """
    motions: dict[str, Withdrawal[F]] = {}
    refused = memory.refused
    for part, posture in perception.posture.items():
        before, own = memory.motions.get(part), wishes.get(part, ())
        if before is None and not own:
            continue
        if own and posture.size != len(own[0].field.motion):
            valid = len(own[0].field.motion)
            raise CommandError(f"{part} has {posture.size} joints; a base motion has {valid}")
        after, reason = withdraw(
            before, own, perception, body, part,
            refractory=refractory, refused=refused.get(part), mode=mode,
        )  # fmt: skip
        if own and after is not None and forbids is not None and (why := forbids(part, after.target)):
            reason = refusal(why, perception)
            # The touch that a part has answered goes on, though it may not move further.
            same = before is not None and before.started == after.started
            after = replace(after, gain=before.gain) if same and before is not None else None
        refused = told(refused, part, after, reason)
        if after is not None:
            motions[part] = after
    return Withdrawals(motions, refused)


def new_targets(
    before: Withdrawals[F], after: Withdrawals[F], mode: Mode = Mode.POSITION
) -> tuple[GenericCommand, ...]:
    """Returns a command for each part whose target changed."""
    return tuple(
        GenericCommand(part, mode, one.target)
        for part, one in after.items()
        if not one.goes_as(before.motions.get(part))
    )


def blind_field(part: str, fields: Iterable[Field], shares: Array) -> Reason | None:
    """Returns the first field that has lost most of its skin, as a reason to stop; `shares` (m,) are the
    fractions of their taxels that are trusted."""
    for one, share in zip(fields, shares.tolist(), strict=True):
        if share < LEAST_COVERAGE:
            return Reason(
                Code.SKIN_BLIND,
                f"the field {one.name} of {part} is blind: {share:.0%} of its taxels can be trusted; "
                f"valid: {LEAST_COVERAGE:.0%} or more",
            )
    return None


def withdraw(
    before: Withdrawal[F] | None,
    wishes: Sequence[Wish[F]],
    perception: Perception,
    body: GenericBody,
    part: str,
    *,
    refractory: float,
    refused: Refusal | None = None,
    mode: Mode = Mode.POSITION,
) -> tuple[Withdrawal[F] | None, Refusal | None]:
    """The withdrawal of a part after this instant, and why it stays where a touch asks for more; what was
    `refused` before may stand."""
    now = perception.stamp
    stands = refused if refused is not None and refused.stands(perception) else None
    # What answers in every step is one touch, however far apart the steps are.
    if before is not None and (before.quiet or not wishes) and now - before.touched >= refractory:
        before = None
    if before is None:
        if not wishes or stands is not None:
            return None, stands if wishes else None
        begun, reason = _begin(wishes, perception, body, part, mode)
        return begun, refusal(reason, perception)
    after, reason = before, ""
    if wishes:
        after = replace(before, touched=now, quiet=False)
        if before.ended is None and stands is None:
            more = [
                one.gain for one in wishes if one.gain > before.gain and _is_same(one.field, before.field)
            ]
            if more:
                grown = replace(after, gain=max(more))
                if not (reason := why_not(perception, body, part, grown.target, mode=mode)):
                    after = grown
    elif not before.quiet:
        after = replace(before, quiet=True)
    after, reason = _meet(after, perception, body, part, mode, reason)
    return after, refusal(reason, perception) or (stands if wishes else None)


def refusal(reason: str, perception: Perception) -> Refusal | None:
    """A refusal for a reason; None for none."""
    return Refusal(reason, _frames(perception), perception.stamp) if reason else None


def told(
    refused: Mapping[str, Refusal], part: str, withdrawal: Withdrawal[F] | None, reason: Refusal | None
) -> Mapping[str, Refusal]:
    """What is `refused`, by part, after a part has gone on with a `withdrawal` or stays for a reason."""
    if reason is not None:
        return refused if refused.get(part) is reason else {**refused, part: reason}
    if part not in refused or withdrawal is None or withdrawal.quiet or withdrawal.ended is not None:
        return refused
    return {name: one for name, one in refused.items() if name != part}


def _begin(
    wishes: Sequence[Wish[F]], perception: Perception, body: GenericBody, part: str, mode: Mode
) -> tuple[Withdrawal[F] | None, str]:
    """The strongest wish of a motion that leads away; why the strongest does not where none does."""
    posture, first = perception.posture[part], ""
    if not np.isfinite(posture).all():
        return None, ""
    origin, now, met = frozen(posture.copy()), perception.stamp, _identities(perception)
    ways: dict[tuple[float, ...], list[Wish[F]]] = {}
    # Names settle a draw, so that the order of contacts plays no part.
    for wish in sorted(wishes, key=lambda wish: (wish.gain, wish.field.name), reverse=True):
        ways.setdefault(wish.field.motion, []).append(wish)
    for same in ways.values():  # one look for each, however many touches there are
        field, gain, _ = same[0]
        begun = Withdrawal(field, origin, gain, now, now, met=met)
        answers = [wish.contact for wish in same]
        reason = why_not(perception, body, part, begun.target, mode=mode, answers=answers)
        if not reason:
            return begun, ""
        first = first or reason
    return None, first


def _meet(
    withdrawal: Withdrawal[F],
    perception: Perception,
    body: GenericBody,
    part: str,
    mode: Mode,
    reason: str,
) -> tuple[Withdrawal[F], str]:
    """The same, ended where the part is if the rest of it would press something that it has met since."""
    met = _identities(perception)
    if withdrawal.ended is not None or met <= withdrawal.met:
        return withdrawal, reason
    if reason := why_not(perception, body, part, withdrawal.target, mode=mode):
        return replace(withdrawal, ended=frozen(perception.posture[part].copy())), reason
    return replace(withdrawal, met=met), ""


def _frames(perception: Perception) -> bytes:
    """Sequences of the skin frames; as bytes they equal those of a copy."""
    return b"" if perception.skin is None else perception.skin.sequence.tobytes()


def _identities(perception: Perception) -> frozenset[int]:
    return frozenset(perception.contacts.identity.tolist())


def _is_same(one: F, other: F) -> bool:
    # Whole fields take long to compare.
    return one is other or (one.name == other.name and one == other)
