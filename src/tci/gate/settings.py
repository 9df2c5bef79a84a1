"""What a gate can be told, and what it counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from tci.errors import TciError
from tci.gate.joint_monitor import MonitorSettings
from tci.gate.self_collision import MARGIN as BODY_MARGIN


@dataclass(frozen=True, slots=True)
class GateSettings:
    """What the description does not say. All figures are ours."""

    speed_share: float = 0.9
    """Share of a servo's speed limit that is commanded, since a real servo overshoots."""
    command_timeout: float = 0.1
    """Age [s] beyond which a velocity or a torque no longer counts: the servo stops, or lets go."""
    self_collision: float | None = BODY_MARGIN
    """Distance [m] that the arms keep from the body and from each other; None: nobody looks."""
    monitor: MonitorSettings | None = field(default_factory=MonitorSettings)
    """When the robot does not do what it is told; None: nobody looks, since another gate does."""

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_share <= 1.0:
            raise TciError(f"speed_share {self.speed_share}; valid: above 0, at most 1")
        if not 0.0 < self.command_timeout < np.inf:
            raise TciError(f"command_timeout {self.command_timeout} s; valid: above 0 and finite")


@dataclass(frozen=True, slots=True)
class GateCounts:
    """What the gate did since it was made."""

    steps: int
    """Control periods."""
    holds: int
    """Times that it began to hold."""
    stops: int
    """Times that it stopped until a reset."""
    refusals: int
    """Commands that it refused whole."""
    near_misses: int
    """Motions that it ended because the robot would have hit itself."""
    clamps: Mapping[str, int]
    """Times that a servo's target was clamped, by servo name."""


class Tally:
    """The same while it is counted."""

    def __init__(self) -> None:
        self.steps = self.holds = self.stops = self.refusals = self.near_misses = 0
        self.clamps: Counter[str] = Counter()

    @property
    def counts(self) -> GateCounts:
        """A copy that stays as it is."""
        clamps = MappingProxyType(dict(self.clamps))
        return GateCounts(self.steps, self.holds, self.stops, self.refusals, self.near_misses, clamps)
