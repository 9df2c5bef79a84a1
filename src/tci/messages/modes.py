"""Control modes of a servo, and the quantities of a command."""

from __future__ import annotations

from enum import Enum
from typing import Literal

from tci.errors import UnknownNameError


class Mode(Enum):
    """Physical quantity of a command's values."""

    POSITION = "position"
    """Joint angles [rad]."""
    VELOCITY = "velocity"
    """Joint velocities [rad/s]."""
    TORQUE = "torque"
    """Joint torques [N m]."""
    IMPEDANCE = "impedance"
    """Equilibrium angles [rad] of a compliant joint."""
    STIFFNESS = "stiffness"
    """Fraction (0..1) of the servo's full stiffness."""
    DAMPING = "damping"
    """Fraction (0..1) of the servo's full damping."""
    EXPECTED_CONTACT = "expected contact"
    """Force [N] on skin with which an `ExpectContact` reaches the gate."""

    @classmethod
    def of(cls, mode: Mode | str) -> Mode:
        """Returns the mode with this name; a mode is returned unchanged. Raises UnknownNameError for an
        unknown name."""
        if isinstance(mode, Mode):
            return mode
        names = {one.value: one for one in cls}
        if not isinstance(mode, str) or mode.lower() not in names:
            raise UnknownNameError("mode", str(mode), names)
        return names[mode.lower()]


ModeLike = Mode | Literal["position", "velocity", "torque", "impedance", "stiffness", "damping"]
"""A mode, or its name. What takes one keeps a `Mode`."""
CONTROL_MODES = (Mode.POSITION, Mode.VELOCITY, Mode.TORQUE, Mode.IMPEDANCE)
"""Control modes of a servo; exactly one of them is active at a time. Stiffness and damping can be set in each
control mode."""
