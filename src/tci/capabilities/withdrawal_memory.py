"""Data of withdrawals: requested responses (wishes), current withdrawals, and refusals of motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tci.messages import Perception
from tci.messages.frames import Array, frozen
from tci.support.records import quick

ANEW = 0.02
"""Time [s] after which a refused motion is checked again, even if no new skin frame has arrived, because the
robot may have moved. Assumed: the period of the slowest skin."""


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
    """Rank of the wish. The wishes of a part are tried in the order of their ranks, those with rank 0
    first."""


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
    """Identities of the contacts for which the motion was checked: it presses no skin into the objects that
    touch at these contacts."""
    ended: Array | None = None
    """Generic posture (n,) [rad] at which the motion was ended because of an object on the path. The value is
    None if the motion was not ended."""

    @property
    def target(self) -> Array:
        """Target posture (n,) [rad]: `origin` + `gain` * base motion, or the posture `ended` if an object
        ended the motion."""
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
    """Reason why a touched part does not move. While the method `stands` returns True, the motion is not
    checked again."""

    reason: str
    frames: bytes
    """Sequence numbers of the skin frames with which the motion was checked."""
    stamp: float
    """Time [s] at which the motion was checked."""
    inputs: tuple[object, ...] | None = None
    """Values that decided if the motion was permitted: joint angles, contacts, wishes and the withdrawal
    before. None if the perception had no joints."""

    def stands(self, before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception) -> bool:
        """Returns True if the motion need not be checked again. There are two cases. The check is recent, and
        no skin frame has arrived after it. Or touch and posture have not changed, so that a new check would
        give the same result."""
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
    """Returns `refused`, the refusals by part, updated after a step of `part`. `withdrawal` and `reason` are
    the withdrawal and the new refusal of this part, if any.

    The refusal of a part is removed when the part moves again.
    """
    if reason is not None:
        return refused if refused.get(part) is reason else {**refused, part: reason}
    if part not in refused or withdrawal is None or withdrawal.quiet or withdrawal.ended is not None:
        return refused
    return {name: one for name, one in refused.items() if name != part}


def _frames(perception: Perception) -> bytes:
    """Returns the sequence numbers of the skin frames as bytes, because bytes can be compared fast."""
    return b"" if perception.skin is None else perception.skin.sequence.tobytes()


def _inputs(
    before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception
) -> tuple[object, ...] | None:
    """Returns all values that decide if a motion is permitted, in a form that can be compared; None if the
    perception has no joints."""
    contacts, joints = perception.contacts, perception.joints
    if joints is None:
        return None
    arrays = joints.position, contacts.site, contacts.force, contacts.p_L, contacts.n_L, contacts.f_T
    begun = None if before is None else (before.started, before.gain)
    return begun, tuple(wishes), *[one.tobytes() for one in arrays]
