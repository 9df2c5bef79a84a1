"""The rules of a withdrawal of any part: once per touch, and never towards the touching object.

A touch in a receptive field starts a *withdrawal* of the touched part. The withdrawal lasts until no field of
the part has been touched for the refractory period. During this time all touches of the part count as one
touch. The gain may increase, at most to 1. No other field responds, and no motion is added twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.retreat import are_hopeless, why_not
from tci.errors import CommandError
from tci.frames import Array, frozen
from tci.messages import GenericCommand, Mode, Perception
from tci.reasons import Code, Reason
from tci.records import quick

ANEW = 0.02
"""Time [s] after which a refused motion is checked again, even if no new skin frame has arrived, because the
robot may have moved. Assumed: the period of the slowest skin."""

LEAST_COVERAGE = 0.5
"""A field is blind if the fraction of its healthy taxels is below this value. Assumed: most touches of the
field are then missed."""


class Field(Protocol):
    """A receptive field with its base motion."""

    @property
    def name(self) -> str:
        """Name of the field."""

    @property
    def motion(self) -> tuple[float, ...]:
        """Base motion Theta_i (n,) [rad] of the generic joints."""


F = TypeVar("F", bound=Field)


class Wish(NamedTuple, Generic[F]):
    """The response that one contact requests."""

    field: F
    """Field that responds. This field contains the contact."""
    gain: float
    """Gain phi(F) psi(d) of the response (eq. 5), above 0 and at most 1."""
    contact: int
    """Index of the contact in `Perception.contacts`."""
    rank: int = 0
    """Order in which the responses of several fields are tried: 0 is tried first."""


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Withdrawal(Generic[F]):
    """Withdrawal of one part."""

    field: F
    """Field that started the withdrawal."""
    origin: Array
    """Generic posture (n,) [rad] of the part at the start of the withdrawal."""
    gain: float
    """Largest gain phi(F) psi(d) (eq. 5) since the start of the withdrawal."""
    started: float
    """Time [s] at which the withdrawal started."""
    touched: float
    """Time [s] of the latest touch in a field of this part."""
    quiet: bool = False
    """True if no field of this part was touched in the latest step."""
    met: frozenset[int] = frozenset()
    """Identities of the contacts that have been compared with the motion. The motion presses into none of
    them."""
    ended: Array | None = None
    """Generic posture (n,) [rad] at which the motion was ended because of an object on the path. The value is
    None if the motion was not ended."""

    @property
    def target(self) -> Array:
        """Target posture (n,) [rad]: `origin` + `gain` * base motion, or `ended`."""
        if self.ended is not None:
            return self.ended
        ways = zip(
            self.origin.tolist(), self.field.motion, strict=True
        )  # a touch is rare: see `Retreat._goal`
        return frozen(np.array([angle + self.gain * way for angle, way in ways]))

    def touched_again(self, now: float, gain: float) -> Withdrawal[F]:
        """Returns the withdrawal after a touch at `now` [s], with a new `gain`. The code calls the
        constructor, because `dataclasses.replace` would take many times as long."""
        return Withdrawal(self.field, self.origin, gain, self.started, now, False, self.met, self.ended)

    def goes_as(self, before: Withdrawal[F] | None) -> bool:
        """Returns True if this withdrawal has the same target as the withdrawal `before`."""
        if before is None or before.ended is not self.ended:
            return False
        return (before.started, before.gain) == (self.started, self.gain)


class Refusal(NamedTuple):
    """Reason why a touched part does not move. The reason is stored, so that the touch is not checked again
    in each period."""

    reason: str
    frames: bytes
    """Sequence numbers of the skin frames with which the motion was checked."""
    stamp: float
    """Time [s] at which the motion was checked."""
    inputs: tuple[object, ...] | None = None
    """All values on which the check depends, see `_inputs`."""

    def stands(self, before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception) -> bool:
        """Returns True if no new check is needed: the check is recent, and no skin frame has arrived after
        it; or a new check would give the same result, because touch and posture have not changed."""
        if perception.stamp - self.stamp < ANEW and _frames(perception) == self.frames:
            return True
        return self.inputs is not None and self.inputs == _inputs(before, wishes, perception)


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawals(Mapping[str, Withdrawal[F]]):
    """Current withdrawals by part, and the reasons for which other touched parts do not move."""

    motions: Mapping[str, Withdrawal[F]]
    refused: Mapping[str, Refusal]
    """Refusals by part, each for the latest touch of the part."""

    def __getitem__(self, part: str) -> Withdrawal[F]:
        return self.motions[part]

    def __iter__(self) -> Iterator[str]:
        return iter(self.motions)

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each touched part that does not move, with the reason."""
        return tuple(
            f"{part} was touched and does not move: {one.reason}" for part, one in self.refused.items()
        )


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
    """Returns the withdrawals of all parts after this instant.

    Args:
        memory: Withdrawals before this instant.
        wishes: Responses that the contacts request, by part.
        perception: Perception of this instant.
        body: The generic body.
        refractory: Time [s] without a wish for a part, after which the touch of the part has ended.
        mode: Control mode of the motions.
        forbids: Further check: a function of a part and its target (n,) [rad] that returns the reason why the
            part must not move to this target, or an empty text if the part may move.

    Raises CommandError if a touched part has another number of joints than the base motion of its field.
    """
    if not memory.motions and not wishes:
        return memory
    motions: dict[str, Withdrawal[F]] = {}
    refused = memory.refused
    met = frozenset(perception.contacts.identity.tolist())
    for part, posture in perception.posture.items():
        before, own = memory.motions.get(part), wishes.get(part, ())
        if before is None and not own:
            continue
        if own and posture.size != len(own[0].field.motion):
            valid = len(own[0].field.motion)
            raise CommandError(
                f"{part} has {posture.size} generic joints; valid: {valid}, as the base motions of its fields"
            )
        after, reason = withdraw(
            before, own, perception, body, part, met,
            refractory=refractory, refused=refused.get(part), mode=mode,
        )  # fmt: skip
        if own and after is not None and forbids is not None and (why := forbids(part, after.target)):
            reason = refusal(why, before, own, perception)
            # The part has already responded to this touch. So the withdrawal continues, but its gain must not
            # increase.
            same = before is not None and before.started == after.started
            after = replace(after, gain=before.gain) if same and before is not None else None
        if reason is not None or part in refused:
            refused = told(refused, part, after, reason)
        if after is not None:
            motions[part] = after
    return Withdrawals(motions, refused)


def new_targets(
    before: Withdrawals[F], after: Withdrawals[F], mode: Mode = Mode.POSITION
) -> tuple[GenericCommand, ...]:
    """Returns a command for each part with a new target."""
    return tuple(
        GenericCommand(part, mode, one.target)
        for part, one in after.motions.items()
        if not one.goes_as(before.motions.get(part))
    )


def blind_field(part: str, fields: Iterable[Field], shares: Array) -> Reason | None:
    """Returns a reason to stop for the first blind field, or None if no field is blind.

    `shares` (m,) are the fractions of healthy taxels of the `fields`.
    """
    for one, share in zip(fields, shares.tolist(), strict=True):
        if share < LEAST_COVERAGE:
            return Reason(
                Code.SKIN_BLIND,
                f"the field {one.name} of {part} is blind: {share:.0%} of its taxels are healthy; "
                f"valid: {LEAST_COVERAGE:.0%} or more",
            )
    return None


def withdraw(
    before: Withdrawal[F] | None,
    wishes: Sequence[Wish[F]],
    perception: Perception,
    body: GenericBody,
    part: str,
    met: frozenset[int],
    *,
    refractory: float,
    refused: Refusal | None = None,
    mode: Mode = Mode.POSITION,
) -> tuple[Withdrawal[F] | None, Refusal | None]:
    """Returns the withdrawal of one part after this instant, and the refusal if a requested motion is
    refused.

    `met` are the identities of all present contacts. `refused` is the last refusal of the part, which stays
    valid while `Refusal.stands` returns True. For the other arguments see `withdraw_all`.
    """
    now = perception.stamp
    # Responses in successive steps count as one touch, even if the time between the steps is long.
    if before is not None and (before.quiet or not wishes) and now - before.touched >= refractory:
        before = None
    stands = refused if refused is not None and refused.stands(before, wishes, perception) else None
    if before is None:
        if not wishes or stands is not None:
            return None, stands if wishes else None
        begun, reason = _begin(wishes, perception, body, part, met, mode)
        return begun, refusal(reason, before, wishes, perception)
    after, reason = before, ""
    if wishes:
        after = before.touched_again(now, before.gain)
        if before.ended is None and stands is None:
            more = [
                one.gain for one in wishes if one.gain > before.gain and _is_same(one.field, before.field)
            ]
            if more:
                grown = before.touched_again(now, max(more))
                if not (reason := why_not(perception, body, part, grown.target, mode=mode)):
                    after = grown
    elif not before.quiet:
        after = replace(before, quiet=True)
    if after.ended is None and not met <= after.met:
        after, reason = _meet(after, perception, body, part, met, mode, reason)
    told_now = refusal(reason, before, wishes, perception)
    return after, told_now or (stands if wishes else None)


def refusal(
    reason: str, before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception
) -> Refusal | None:
    """Returns a refusal with this reason, or None if the reason is empty. `before` is the withdrawal of the
    part before this instant."""
    if not reason:
        return None
    return Refusal(reason, _frames(perception), perception.stamp, _inputs(before, wishes, perception))


def told(
    refused: Mapping[str, Refusal], part: str, withdrawal: Withdrawal[F] | None, reason: Refusal | None
) -> Mapping[str, Refusal]:
    """Returns the refusals by part after a step of one part, with its `withdrawal` and its new refusal, if
    any.

    The refusal of a part is removed when the part moves again.
    """
    if reason is not None:
        return refused if refused.get(part) is reason else {**refused, part: reason}
    if part not in refused or withdrawal is None or withdrawal.quiet or withdrawal.ended is not None:
        return refused
    return {name: one for name, one in refused.items() if name != part}


def _begin(
    wishes: Sequence[Wish[F]],
    perception: Perception,
    body: GenericBody,
    part: str,
    met: frozenset[int],
    mode: Mode,
) -> tuple[Withdrawal[F] | None, str]:
    """Starts the motion of the first permitted wish, in order of rank and gain. If no wish is permitted,
    returns None and the reason for which the first wish is refused."""
    posture, first = perception.posture[part], ""
    if not all(map(isfinite, posture.tolist())):
        return None, ""
    origin, now = frozen(posture.copy()), perception.stamp
    ways: dict[tuple[float, ...], list[Wish[F]]] = {}
    # Equal gains are sorted by name, so that the result does not depend on the order of contacts.
    for wish in sorted(wishes, key=lambda wish: (-wish.rank, wish.gain, wish.field.name), reverse=True):
        ways.setdefault(wish.field.motion, []).append(wish)
    # Each motion is checked only once, even if several touches request it. After the first refusal, the fast
    # check `are_hopeless` examines all other motions.
    hopeless = [False] * len(ways)
    for k, same in enumerate(ways.values()):
        if hopeless[k]:
            continue
        begun = Withdrawal(same[0].field, origin, same[0].gain, now, now, met=met)
        answers = [wish.contact for wish in same]
        reason = why_not(perception, body, part, begun.target, mode=mode, answers=answers)
        if not reason:
            return begun, ""
        if k == 0 and len(ways) > 1:
            gains = np.array([own[0].gain for own in ways.values()])
            targets = origin + gains[:, None] * np.array([*ways])
            contacts = [[wish.contact for wish in own] for own in ways.values()]
            hopeless = are_hopeless(perception, body, part, targets, contacts)
        first = first or reason
    return None, first


def _meet(
    withdrawal: Withdrawal[F],
    perception: Perception,
    body: GenericBody,
    part: str,
    met: frozenset[int],
    mode: Mode,
    reason: str,
) -> tuple[Withdrawal[F], str]:
    """Ends a withdrawal at the present posture if its remaining motion would press one of the contacts `met`.

    Returns the withdrawal, and the reason for which the withdrawal was ended. If the withdrawal was not
    ended, the second value is `reason`.
    """
    if reason := why_not(perception, body, part, withdrawal.target, mode=mode):
        return replace(withdrawal, ended=frozen(perception.posture[part].copy())), reason
    return replace(withdrawal, met=met), ""


def _frames(perception: Perception) -> bytes:
    """Returns the sequence numbers of the skin frames as bytes, because bytes can be compared fast."""
    return b"" if perception.skin is None else perception.skin.sequence.tobytes()


def _inputs(
    before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception
) -> tuple[object, ...] | None:
    """Returns all values on which the check of a motion depends; None if the perception has no joints."""
    contacts, joints = perception.contacts, perception.joints
    if joints is None:
        return None
    arrays = joints.position, contacts.site, contacts.force, contacts.p_L, contacts.n_L, contacts.f_T
    begun = None if before is None else (before.started, before.gain)
    return begun, tuple(wishes), *[one.tobytes() for one in arrays]


def _is_same(one: F, other: F) -> bool:
    # Comparing all values of two fields is slow, so identity and name are compared first.
    return one is other or (one.name == other.name and one == other)
