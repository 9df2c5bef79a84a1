"""The only message that a driver writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.frames import Array
from tci.messages import Mode, PlatformOrder
from tci.reasons import Reason


class GateState(Enum):
    """State of the gate."""

    RUN = "run"
    """Commands pass, within the limits."""
    HOLD = "hold"
    """Joint data is too old or not usable: stop, keep the position. Clears by itself."""
    STOP = "stop"
    """Something is wrong with the robot or the program: as hold, but until an operator resets it."""


@dataclass(frozen=True, slots=True)
class GateToken:
    """Token that proves a `SafeCommand` was created by a gate."""

    robot: str
    """Name of the robot that the gate is for."""


@dataclass(frozen=True, slots=True, eq=False)
class SafeCommand:
    """Command that may be written now. Only a gate makes it, for its own driver, once."""

    seal: object = field(repr=False)
    """Token of the gate; anything else raises DriverError."""
    stamp: float
    """Time [s] when it was made."""
    state: GateState
    """State of the gate then."""
    servos: NDArray[np.intp]
    """Indices (k,) of servos that are under command; no other joint is ever sent anything."""
    modes: tuple[Mode, ...]
    """Control mode of each of them (k,). A driver switches a servo to it before it sends the rest."""
    position: Array
    """Angle (k,) [rad] of each at the end of this period: the set-point; in impedance mode the equilibrium,
    in torque mode the measured one."""
    velocity: Array
    """Velocity (k,) [rad/s] of each then; 0 in torque mode."""
    torque: Array
    """Torque of each of them (k,) [N m] in torque mode; 0 in the others."""
    stiffness: Mapping[int, float]
    """New share 0..1 of full stiffness, by servo index, where commanded."""
    damping: Mapping[int, float]
    """New share 0..1 of full damping, by servo index, where commanded."""
    clamped: tuple[str, ...]
    """Messages on what was clamped or cut short."""
    refusals: tuple[Reason, ...]
    """Reason of each command that was refused."""
    reason: Reason | None = None
    """Reason for which the gate holds or has stopped; None while it runs."""
    orders: tuple[PlatformOrder, ...] = ()
    """Orders that it took over in this step. A driver of another TCI process sends these: the gate
    there makes the motion."""

    def __post_init__(self) -> None:
        if not isinstance(self.seal, GateToken):
            raise DriverError("only a gate makes a SafeCommand: use link.gate.step(...)")
