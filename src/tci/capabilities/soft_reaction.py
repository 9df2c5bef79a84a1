"""A soft reaction: a touched part yields in the direction of the force.

The transposed Jacobian converts the contact force to torques of the generic joints, tau = J^T f (Khatib
1987). In torque mode these torques are commanded. In velocity mode, which every robot has, the commanded
joint velocities are proportional to these torques (admittance control, Hogan 1985).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.retreat import AHEAD
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.capabilities.retreat import why_not
from tci.errors import TciError
from tci.messages import Command, GenericCommand, Mode, ModeLike, Perception, SwitchMode
from tci.messages.frames import Array, read_only

MODES = (Mode.VELOCITY, Mode.TORQUE)
"""Control modes in which the soft reaction can run."""
NO_JOINT = "it has no joint on this robot"
"""Text for a touched part that does not yield because the robot has no joint of this part."""


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Latest measured posture of a part, and its posture at the end of the last touch."""

    stamp: float
    """Time [s] of the last posture."""
    angles: Array
    """Last generic angles (n,) [rad]."""
    home: Array
    """Generic angles (n,) [rad] at the end of the last touch. In torque mode the part is held at these
    angles."""
    refused: str = ""
    """Reason why the touched part does not yield. The text is empty if the part yields."""
    touched: bool = False
    """True while the part is touched."""


Postures = Mapping[str, Posture]
"""Memory of a soft reaction: the posture of each part, by part name."""


@dataclass(frozen=True)
class SoftReaction(Capability[Postures]):
    """Lets parts yield to touches. Raises TciError for a setting out of range.

    The defaults are assumed, since no values are published for these robots.
    """

    parts: tuple[str, ...] = ("left_arm", "right_arm")
    """Generic parts that yield."""
    mode: ModeLike = Mode.VELOCITY
    """Control mode: velocity or torque. Use torque mode only on a robot that compensates gravity itself."""
    mobility: float = 3.0
    """In velocity mode: commanded velocity divided by the torque of the touch [rad/s per N m]."""
    gain: float = 1.0
    """In torque mode: commanded torque divided by the torque of the touch. The motor then adds to the torque
    of the touch, so that the part yields to a smaller force."""
    stiffness: float = 8.0
    """In torque mode: stiffness [N m/rad] of a part that is not touched."""
    damping: float = 0.4
    """In torque mode: damping [N m s/rad] of every motion."""
    threshold: float = 0.3
    """Smallest force [N] of a contact to which a part yields."""

    def __post_init__(self) -> None:
        mode = Mode.of(self.mode)
        object.__setattr__(self, "mode", mode)
        if mode not in MODES:
            valid = ", ".join(one.value for one in MODES)
            raise TciError(f"soft reaction: mode {mode.value}; valid: {valid}")
        for name in ("mobility", "gain", "stiffness", "damping", "threshold"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise TciError(f"soft reaction: {name} {getattr(self, name)}; valid: 0 or more, finite")

    @property
    def needs(self) -> tuple[Need, ...]:
        return (Need(f"skin on {' or '.join(self.parts)}", self.parts),)

    def init(self, body: GenericBody) -> Postures:
        return {}

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        """Returns one order for each of `parts`: to switch to the control mode `mode`. Parts without a joint
        on this robot get no order."""
        return tuple(SwitchMode(part, self.mode) for part in self.parts if np.any(body.has_joint(part)))

    def step(
        self, memory: Postures, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], Postures]:
        """Returns a command for each of `parts` that has a joint on this robot. Raises TciError for a part
        that the robot lacks."""
        commands, postures = [], {}
        for part in self.parts:
            if part not in perception.posture:
                raise TciError(
                    f"soft reaction: the robot has no part {part!r}; valid: {', '.join(perception.posture)}"
                )
            touches = [
                index
                for index, touch in enumerate(perception.contacts)
                if touch.part == part and touch.force >= self.threshold
            ]
            angles, now = perception.posture[part], perception.stamp
            if not np.any(body.has_joint(part)):
                postures[part] = Posture(now, angles, angles, NO_JOINT if touches else "")
                continue
            torque, refused = self._torque(part, touches, perception, body)
            before = memory.get(part, Posture(now, angles, angles))
            home = angles if touches else before.home
            if self.mode is Mode.VELOCITY:
                values = self.mobility * torque
            else:
                elapsed = now - before.stamp
                speed = (angles - before.angles) / elapsed if elapsed > 0.0 else np.zeros(angles.size)
                values = self.gain * torque + self.stiffness * (home - angles) - self.damping * speed
            commands.append(GenericCommand(part, self.mode, read_only(values)))
            postures[part] = Posture(now, angles, home, refused, bool(touches))
        return tuple(commands), postures

    def _torque(
        self, part: str, touches: Sequence[int], perception: Perception, body: GenericBody
    ) -> tuple[Array, str]:
        """Torques (n,) [N m] of `touches`, indices of contacts on `part` (Khatib 1987). If the part must not
        yield, they are 0, and the text says why."""
        torque = np.zeros(perception.posture[part].size)
        for touch in [perception.contacts[index] for index in touches]:
            torque += body.jacobian(perception, touch).T @ touch.f_T
        if not (self.mobility * torque).any():
            return torque, ""
        # A motion along the skin is refused, since the part would not yield. Limits of joints can turn a
        # motion into this direction. The least distance is 0, since a light touch moves a part less far than
        # a withdrawal.
        refused = why_not(
            perception,
            body,
            part,
            perception.posture[part] + AHEAD * (self.mobility * torque),
            mode=Mode.of(self.mode),
            answers=touches,
            least=0.0,
            driven=self.mode is Mode.VELOCITY,
        )
        return (np.zeros(torque.size) if refused else torque), refused

    def claims(self, memory: Postures) -> frozenset[str]:
        """The parts that yield to a touch."""
        return frozenset(part for part, one in memory.items() if one.touched and not one.refused)

    def notes(self, memory: Postures) -> tuple[str, ...]:
        """Returns a sentence for each touched part that does not yield, with the reason."""
        return tuple(
            f"{part} was touched and does not move: {posture.refused}"
            for part, posture in memory.items()
            if posture.refused
        )
