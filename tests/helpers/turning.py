"""A task in velocity mode, below a reflex in another mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode

ARMS = ("left_arm", "right_arm")


@dataclass(frozen=True)
class Turn(Capability[None]):
    """Bends both elbows to and fro, by velocities."""

    phase: float = 0.0
    """Where in the motion it begins [rad]."""
    speed: float = 0.4
    """Largest velocity [rad/s]."""

    def init(self, body: GenericBody) -> None:
        return None

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return tuple(SwitchMode(part, Mode.VELOCITY) for part in ARMS)

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        speed = np.array([0.0, 0.0, 0.0, self.speed * np.cos(8.0 * perception.stamp + self.phase), 0.0])
        return tuple(GenericCommand(part, Mode.VELOCITY, speed) for part in ARMS), None
