"""A small motion, so that something is there to stop, to pause or to lead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.errors import TciError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.frames import read_only


@dataclass(frozen=True, slots=True)
class SwayMemory:
    """How far a sway is."""

    began: float
    """[s]."""
    turned: int
    """How many times."""
    arms: tuple[str, ...]


@dataclass(frozen=True)
class Sway(Capability[SwayMemory | None]):
    """Both arms sway slowly about their initial posture. Raises TciError for a setting out of range."""

    angle: float = 0.15
    """Angle [rad] by which elbows and shoulders sway to each side: visible, and beside nobody's arm."""
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
        arms = tuple(arm for arm in body.parts("arm") if np.any(body.has_joint(arm)))
        memory = memory or SwayMemory(perception.stamp, 0, arms)
        due = 1 + int((perception.stamp - memory.began) / self.turn)
        if due <= memory.turned:
            return (), memory
        way = self.angle * (-1) ** due * np.array([1.0, 0.0, 0.0, 1.0, 0.0])
        orders = [
            GenericCommand(
                arm,
                Mode.POSITION,
                read_only(body.robot.part(arm).initial_posture + way),
                2.0 * self.angle / self.turn,
            )
            for arm in memory.arms
        ]
        return tuple(orders), replace(memory, turned=due)

    def claims(self, memory: SwayMemory | None) -> frozenset[str]:
        """Both arms, from the first step on."""
        return frozenset(() if memory is None else memory.arms)
