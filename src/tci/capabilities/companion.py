"""A robot that people touch: it is taught by hand, protects itself, and looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tci.capabilities.arbiter import Arbiter, ArbiterMemory
from tci.capabilities.attend.capability import Attend
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.capability import Capability
from tci.capabilities.finger_reflex.capability import FingerReflex
from tci.capabilities.needs import Need
from tci.capabilities.teach.capability import MOST, Taught, Teach
from tci.capabilities.teach.motion import Motion
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.gestures.gesture import Gesture

LIGHTLY = 8.0
"""Force [N] up to which a touch guides. A hand that guides an arm feels 4 to 5 N, and up to 7 N at the start;
of a poke that an arm gives way to, 9 to 19 N are left."""


@dataclass(frozen=True)
class Companion(Arbiter):
    """Pokes make it flinch, pats make it look, hands guide its arms; `tci demo --show touch` shows it.

    Light touches are those of `Teach`, above the reflexes of arms, body and fingers, so that a guided arm
    does not flinch; attention moves what these leave. What a robot has no skin for stays still.
    """

    layers: Sequence[Capability[Any]] = field(init=False)
    """The capabilities, the highest priority first."""
    gesture: Gesture | None = None
    """A motion that it knows: a tap has it played, and touch corrects it."""
    lightly: float = LIGHTLY
    """Force [N] up to which touches guide; above it the reflexes answer."""

    def __post_init__(self) -> None:
        least, most = MOST
        if not least <= self.lightly <= most:
            raise TciError(f"companion: lightly {self.lightly}; valid: {least:g} to {most:g}")
        layers = (
            Teach(gesture=self.gesture, most=self.lightly),
            WithdrawalReflex(),
            BodyWithdrawal(),
            FingerReflex(),
            Attend(),
        )
        object.__setattr__(self, "layers", layers)
        super().__post_init__()

    @property
    def needs(self) -> tuple[Need, ...]:
        return (Need("skin on any part"),)


def taught_in(memory: object) -> Motion | None:
    """What was taught last, by the memory of `Teach` or of an `Arbiter` with it; None if nothing was."""
    if isinstance(memory, ArbiterMemory):
        return next(filter(None, (taught_in(layer.memory) for layer in memory.layers)), None)
    return memory.motion if isinstance(memory, Taught) else None
