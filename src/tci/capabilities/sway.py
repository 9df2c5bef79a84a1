"""A small motion, so that something is there to stop, to pause or to lead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.limbs import limbs
from tci.errors import TciError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.frames import Array, read_only
from tci.robot.generic_fingers import FLEXIONS


@dataclass(frozen=True, slots=True)
class SwayMemory:
    """How far a sway is."""

    began: float
    """[s]."""
    turned: int
    """How many times."""
    limbs: tuple[str, ...]


@dataclass(frozen=True)
class Sway(Capability[SwayMemory | None]):
    """Arms sway slowly about their initial posture, and the fingers of a hand that no arm carries bend and
    straighten. Raises TciError for a setting out of range."""

    angle: float = 0.15
    """Angle [rad] by which elbows and shoulders sway to each side: visible, and beside nobody's arm. Fingers
    bend by twice as much."""
    turn: float = 1.5
    """Time [s] from turn to turn."""

    def __post_init__(self) -> None:
        for name in ("angle", "turn"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"sway: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> SwayMemory | None:
        return None

    def step(
        self, memory: SwayMemory | None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], SwayMemory]:
        memory = memory or SwayMemory(perception.stamp, 0, limbs(body))
        due = 1 + int((perception.stamp - memory.began) / self.turn)
        if due <= memory.turned:
            return (), memory
        side, speed = (-1) ** due, 2.0 * self.angle / self.turn
        orders = [
            GenericCommand(limb, Mode.POSITION, self._turned(body, limb, side), speed)
            for limb in memory.limbs
        ]
        return tuple(orders), replace(memory, turned=due)

    def claims(self, memory: SwayMemory | None) -> frozenset[str]:
        """What it moves, from the first step on."""
        return frozenset(() if memory is None else memory.limbs)

    def _turned(self, body: GenericBody, limb: str, side: int) -> Array:
        """Where a limb turns (n,) [rad]."""
        part = body.robot.part(limb)
        if part.kind == "fingers":  # first they bend
            bent = np.isin(np.arange(len(part.servos)), FLEXIONS) & body.has_joint(limb)
            return read_only(part.initial_posture + self.angle * (1 - side) * bent)
        return read_only(part.initial_posture + self.angle * side * np.array([1.0, 0.0, 0.0, 1.0, 0.0]))
