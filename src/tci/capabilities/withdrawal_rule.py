"""The rules of a withdrawal of any part: once per touch, and never towards the touching object.

A touch in a receptive field starts a *withdrawal* of the touched part. The withdrawal lasts until no field of
the part has been touched for the refractory period. During this time all touches of the part count as one
touch. The gain may increase, at most to 1. No other field responds, and no base motion is added a second
time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.retreat import are_hopeless, why_not
from tci.capabilities.withdrawal_memory import F, Field, Refusal, Wish, Withdrawal, Withdrawals, refusal, told
from tci.errors import CommandError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.frames import Array, frozen
from tci.reasons import Code, Reason

LEAST_COVERAGE = 0.5
"""A field is blind if the fraction of its healthy taxels is below this value. Assumed: most touches of the
field are then missed."""


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
        refractory: The touch of a part ends when there has been no wish for the part for this time [s].
        mode: Control mode of the motions.
        forbids: Further check. Receives a part and its target (n,) [rad]. Returns the reason why the part
            must not move to this target, or an empty text if the part may move.

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
    """Returns a reason to stop that names the first blind field: the first with a healthy fraction below
    LEAST_COVERAGE. Returns None if no field is blind.

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
    valid while `Refusal.stands` returns True. `before` is the withdrawal before this instant, and `wishes`
    are the responses that the contacts request. The withdrawal ends when there has been no wish for
    `refractory` [s].
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


def _begin(
    wishes: Sequence[Wish[F]],
    perception: Perception,
    body: GenericBody,
    part: str,
    met: frozenset[int],
    mode: Mode,
) -> tuple[Withdrawal[F] | None, str]:
    """Returns the withdrawal for the first permitted response in `wishes` (the requested responses).
    Responses with a lower rank are tried first, and among equal ranks those with a larger gain. If none is
    permitted, returns None and the reason why the first is refused (empty if the posture is unknown).
    """
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
    """Ends a withdrawal at the present posture if its remaining motion would press skin into a touching
    object. `met` are the identities of all present contacts.

    Returns the withdrawal, and the reason why it was ended; if it was not ended, the argument `reason`.
    """
    if why := why_not(perception, body, part, withdrawal.target, mode=mode):
        return replace(withdrawal, ended=frozen(perception.posture[part].copy())), why
    return replace(withdrawal, met=met), reason


def _is_same(one: F, other: F) -> bool:
    # Comparing all values of two fields is slow, so identity and name are compared first.
    return one is other or (one.name == other.name and one == other)
