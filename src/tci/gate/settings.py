"""Settings of a gate, and its counters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from tci.errors import TciError
from tci.gate.contact.settings import ContactSettings
from tci.gate.joint_monitor import MonitorSettings
from tci.gate.self_collision import MARGIN as BODY_MARGIN


@dataclass(frozen=True, slots=True)
class GateSettings:
    """Settings of a gate that the robot's description does not contain. All default values are assumed."""

    speed_share: float = 0.9
    """Largest commanded speed, as a fraction of the speed limit of a servo. The remaining fraction is a
    reserve, because a real servo overshoots."""
    command_timeout: float = 0.1
    """Age [s] above which a velocity or torque command expires. After this time the servo stops, or its
    torque ends."""
    self_collision: float | None = BODY_MARGIN
    """Distance [m] that the arms keep from the body and from each other. None disables the check for
    self-collision."""
    monitor: MonitorSettings | None = field(default_factory=MonitorSettings)
    """Thresholds of the check that the robot follows its reference. None disables the check. Use None only if
    another gate makes this check."""

    contact: ContactSettings | None = field(default_factory=ContactSettings)
    """When a contact counts, and how the gate answers it. None disables the answer. Use None only if another
    gate answers."""

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_share <= 1.0:
            raise TciError(f"speed_share {self.speed_share}; valid: above 0, at most 1")
        if not 0.0 < self.command_timeout < np.inf:
            raise TciError(f"command_timeout {self.command_timeout} s; valid: above 0 and finite")


def over_a_wire(*, softens: bool) -> GateSettings:
    """Settings for robots behind a wire, whose lag nobody has measured: some plan their own motion to a
    target, some wait for a busy network. The joint monitor allows the same 6 degrees. `softens`: see
    `ContactSettings`."""
    held = float(np.deg2rad(6.0))
    return GateSettings(contact=ContactSettings(held=held, lag=0.3, stands=False, softens=softens))


OVER_A_WIRE = over_a_wire(softens=False)


@dataclass(frozen=True, slots=True)
class GateCounts:
    """Counters of a gate since it was created."""

    steps: int
    """Number of control periods."""
    torque_steps: int
    """Number of those in which measured joint torques told whether a part met something. In others only skin
    did, and joints that stayed behind."""
    holds: int
    """Number of times that the gate began to hold."""
    stops: int
    """Number of times that the gate stopped until a reset."""
    refusals: int
    """Number of commands that the gate refused entirely."""
    near_misses: int
    """Number of motions that the gate ended to avoid a self-collision."""
    clamps: Mapping[str, int]
    """Number of times that a servo's target was clamped, by servo name."""


class Tally:
    """Counters that a gate increases while it runs."""

    def __init__(self) -> None:
        self.steps = self.torque_steps = self.holds = self.stops = self.refusals = self.near_misses = 0
        self.clamps: Counter[str] = Counter()

    @property
    def counts(self) -> GateCounts:
        """Returns a copy of the counters, which does not change later."""
        clamps = MappingProxyType(dict(self.clamps))
        return GateCounts(
            self.steps, self.torque_steps, self.holds, self.stops, self.refusals, self.near_misses, clamps
        )  # fmt: skip
