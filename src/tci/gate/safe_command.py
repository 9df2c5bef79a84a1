"""The command that a driver writes: only a gate can create it."""

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
    """Joint data is too old or not usable: the robot stops and keeps its position. Ends by itself."""
    STOP = "stop"
    """A fault of the robot or the program: as HOLD, but until an operator resets the gate."""


@dataclass(frozen=True, slots=True)
class GateToken:
    """Token that proves a `SafeCommand` was created by a gate."""

    robot: str
    """Name of the robot that the gate is for."""


@dataclass(frozen=True, slots=True, eq=False)
class SafeCommand:
    """Command that may be written now. A gate creates it for its own driver, which may write it once."""

    seal: object = field(repr=False)
    """Token of the gate; without it the constructor raises DriverError."""
    stamp: float
    """Time [s] at which it was made."""
    state: GateState
    """State of the gate."""
    servos: NDArray[np.intp]
    """Indices (k,) of the servos under command. Nothing is ever sent to other servos."""
    modes: tuple[Mode, ...]
    """Control mode (k,) of each servo. A driver switches a servo to this mode before it sends other
    values."""
    position: Array
    """Position (k,) [rad] of each servo at the end of this period: the set-point, in impedance mode the
    equilibrium, in torque mode the measured position."""
    velocity: Array
    """Velocity (k,) [rad/s] of each servo at that time; 0 in torque mode."""
    torque: Array
    """Torque (k,) [N m] of each servo in torque mode; 0 in other modes."""
    stiffness: Mapping[int, float]
    """New fraction (0..1) of full stiffness, by servo index, if commanded."""
    damping: Mapping[int, float]
    """New fraction (0..1) of full damping, by servo index, if commanded."""
    clamped: tuple[Reason, ...]
    """Values that were clamped (CLAMPED) and motions that were ended (SELF_COLLISION)."""
    refusals: tuple[Reason, ...]
    """Reasons of the commands that were refused."""
    reason: Reason | None = None
    """Reason for which the gate holds or has stopped; None in RUN."""
    orders: tuple[PlatformOrder, ...] = ()
    """Orders that were accepted in this step. A driver that is connected to another TCI process sends these
    orders instead, since the gate of that process plans the motion."""

    def __post_init__(self) -> None:
        if not isinstance(self.seal, GateToken):
            raise DriverError("only a gate makes a SafeCommand: use driver.gate.step(...)")
