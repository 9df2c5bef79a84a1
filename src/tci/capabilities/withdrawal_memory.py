"""What a withdrawal remembers: the responses that contacts ask for, the motions, and the refusals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tci.body.pace import UNBOUNDED, Pace
from tci.messages import Perception
from tci.messages.frames import Array, frozen

LASTS = 1.0
"""Time [s] after which a touch that lasts is told: the part has gone as far as it goes for one touch."""
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
RESPONSES = ("blended", "meant", "printed")
"""Valid values of the setting `response`."""


class Response(NamedTuple):
    """A motion that answers a contact."""

    name: str
    """Name of the field, or of the segment or part whose fields are blended."""
    motion: tuple[float, ...]
    """Full motion (n,) [rad]: the base motion of the field, or the blend."""


class Wish(NamedTuple, Generic[F]):
    """The response that one contact asks for."""

    field: F
    """Field that contains the contact."""
    gain: float
    """Gain phi(F) psi(d) (eq. 5), above 0 and at most 1."""
    contact: int
    """Index of the contact in `Perception.contacts`."""


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawal(Generic[F]):
    """Withdrawal of one part."""

    field: F
    """Field that started the withdrawal."""
    origin: Array
    """Generic posture (n,) [rad] of the part at the start."""
    gain: float
    """Largest gain phi(F) psi(d) (eq. 5) since the start."""
    target: Array
    """Posture (n,) [rad] to which the part moves: `target_of`, or where an object ended the motion."""
    started: float
    """Time [s] of the start."""
    touched: float
    """Time [s] of the latest touch in a field of this part."""
    met: frozenset[int]
    """Identities of the contacts into whose objects the motion presses no skin."""
    quiet: bool = False
    """True if no field of this part was touched in the latest step."""
    ended: bool = False
    """True if an object on the path ended the motion."""
    pace: Pace = UNBOUNDED
    """How fast it goes, and how hard it strikes whoever stands in its way at most."""

    def goes_as(self, before: Withdrawal[F] | None) -> bool:
        """True if this withdrawal has the same target as `before`."""
        return before is not None and (self.started, self.gain, self.ended) == (
            before.started,
            before.gain,
            before.ended,
        )


def target_of(origin: Array, gain: float, field: Field) -> Array:
    """Target posture (n,) [rad] of a withdrawal (eq. 5): `origin` + phi(F) psi(d) Theta_i."""
    ways = zip(origin.tolist(), field.motion, strict=True)  # faster than NumPy for so few numbers
    return frozen(np.array([angle + gain * way for angle, way in ways]))


class Refusal(NamedTuple):
    """Why a touched part does not move."""

    reason: str
    frames: bytes
    """Sequence numbers of the skin frames with which the motion was checked."""
    stamp: float
    """Time [s] of the check."""
    inputs: tuple[object, ...] | None = None
    """Joint angles, contacts, wishes and withdrawal that decided; None for a perception without joints."""

    @classmethod
    def of(
        cls, reason: str, before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception
    ) -> Refusal | None:
        """None if there is no `reason`."""
        if not reason:
            return None
        return cls(reason, _frames(perception), perception.stamp, _inputs(before, wishes, perception))

    def stands(self, before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception) -> bool:
        """True if the motion need not be checked again: the check is recent and no skin frame has arrived
        since, or touch and posture are the same."""
        if perception.stamp - self.stamp < ANEW and _frames(perception) == self.frames:
            return True
        return self.inputs is not None and self.inputs == _inputs(before, wishes, perception)


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawals(Mapping[str, Withdrawal[F]]):
    """Withdrawals by part, and why other touched parts do not move."""

    motions: Mapping[str, Withdrawal[F]]
    refused: Mapping[str, Refusal]
    """By part, for its latest touch."""

    def __getitem__(self, part: str) -> Withdrawal[F]:
        return self.motions[part]

    def __iter__(self) -> Iterator[str]:
        return iter(self.motions)

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each touched part that does not move, for each that moved and is still touched, and
        for each that moves slower than it can."""
        still = [f"{part} was touched and does not move: {one.reason}" for part, one in self.refused.items()]
        lasting = [
            f"{part} has moved as far as it goes for one touch, which has not ended after {LASTS:g} s; "
            "valid: take the object away, then it answers again"
            for part, one in self.motions.items()
            if part not in self.refused and not one.quiet and one.touched - one.started >= LASTS
        ]
        slow = [
            f"{part} withdraws at {one.pace.share:.0%} of its speed, so that whoever stands in its way gets "
            f"at most {one.pace.force:.0f} N"
            for part, one in self.motions.items()
            if one.pace.speed is not None and not one.ended
        ]
        return (*still, *lasting, *slow)


def _frames(perception: Perception) -> bytes:
    return b"" if perception.skin is None else perception.skin.sequence.tobytes()


def _inputs(
    before: Withdrawal[F] | None, wishes: Sequence[Wish[F]], perception: Perception
) -> tuple[object, ...] | None:
    contacts, joints = perception.contacts, perception.joints
    if joints is None:
        return None
    arrays = joints.position, contacts.site, contacts.force, contacts.p_L, contacts.n_L, contacts.f_T
    begun = None if before is None else (before.started, before.gain)
    return begun, tuple(wishes), *[one.tobytes() for one in arrays]
