"""A soft reaction: a touched part gives way along the force, like a limb that is pushed.

The force at the contact becomes torques of the generic joints through the Jacobian's transpose,
tau = J^T f (Khatib 1987). In torque mode these are sent, in velocity mode, which every robot has, the
joints move at a velocity in their proportion (admittance control, Hogan 1985).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.retreat import why_not
from tci.errors import TciError
from tci.frames import Array, read_only
from tci.messages import Command, GenericCommand, Mode, Perception, SwitchMode

AHEAD = 0.1
"""Time [s] of a motion that is judged: what is felt is known again long before."""
MODES = (Mode.VELOCITY, Mode.TORQUE)
"""Forms of the soft reaction."""


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Where a part was, and where it stays when nothing touches it."""

    stamp: float
    """When it was seen [s]."""
    angles: Array
    """Generic angles (n,) [rad] then."""
    home: Array
    """Generic angles (n,) [rad] that torque mode holds; where the last touch left it."""
    refused: str = ""
    """Why it stays though it is touched; empty when it goes along."""


Postures = Mapping[str, Posture]
"""The memory: of each part that reacts, by name."""


@dataclass(frozen=True)
class SoftReaction(Capability[Postures]):
    """Lets every part with skin yield to touches. Defaults are ours. Raises TciError for settings."""

    parts: tuple[str, ...] = ("left_arm", "right_arm")
    """Generic parts that react."""
    mode: Mode = Mode.VELOCITY
    """Velocity or torque. In torque mode the robot must carry its own weight."""
    mobility: float = 3.0
    """Velocity per torque [rad/s per N m] in velocity mode."""
    gain: float = 1.0
    """Torque beside the touch's own, as a share of it, in torque mode: above 0 the part goes along."""
    stiffness: float = 8.0
    """With which torque mode holds a part that is not touched [N m/rad]."""
    damping: float = 0.4
    """Of all motion in torque mode [N m s/rad]."""
    threshold: float = 0.3
    """Force [N] from which a contact counts."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", Mode.of(self.mode))
        if self.mode not in MODES:
            valid = ", ".join(mode.value for mode in MODES)
            raise TciError(f"a soft reaction in {self.mode.value} mode; valid: {valid}")
        for name in ("mobility", "gain", "stiffness", "damping", "threshold"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise TciError(f"soft reaction: {name} {getattr(self, name)}; valid: 0 or more, finite")

    def init(self, body: GenericBody) -> Postures:
        return {}

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        """The control mode of its parts."""
        return tuple(SwitchMode(part, self.mode) for part in self.parts)

    def step(
        self, memory: Postures, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], Postures]:
        """A command for each part. Raises TciError when a part is not the robot's."""
        commands, postures = [], {}
        for part in self.parts:
            if part not in perception.posture:
                raise TciError(f"soft reaction of {part!r}; this robot has {', '.join(perception.posture)}")
            angles = perception.posture[part]
            torque = np.zeros(angles.size)
            touches = [
                touch for touch in perception.contacts if touch.part == part and touch.force >= self.threshold
            ]
            for touch in touches:
                torque += body.jacobian(perception, touch).T @ touch.f_T
            velocity = self.mobility * torque
            target = angles + AHEAD * velocity
            reason = why_not(perception, body, part, target, mode=self.mode) if velocity.any() else ""
            if reason:  # between two touches
                torque, velocity = np.zeros(angles.size), np.zeros(angles.size)
            before = memory.get(part, Posture(perception.stamp, angles, angles))
            home = angles if touches else before.home
            if self.mode is Mode.VELOCITY:
                values = velocity
            else:
                elapsed = perception.stamp - before.stamp
                speed = (angles - before.angles) / elapsed if elapsed > 0.0 else np.zeros(angles.size)
                values = self.gain * torque + self.stiffness * (home - angles) - self.damping * speed
            commands.append(GenericCommand(part, self.mode, read_only(values)))
            postures[part] = Posture(perception.stamp, angles, home, reason)
        return tuple(commands), postures

    def notes(self, memory: Postures) -> tuple[str, ...]:
        """Which parts stay though they are touched, and why."""
        return tuple(
            f"{part} was touched and stays: {posture.refused}"
            for part, posture in memory.items()
            if posture.refused
        )
