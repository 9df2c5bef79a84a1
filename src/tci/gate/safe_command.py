"""The command that a driver writes to its robot. Only a gate can create this command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.messages import Met, Mode, PlatformOrder
from tci.messages.frames import Array
from tci.reasons import Reason


class GateState(Enum):
    """State of the gate."""

    RUN = "run"
    """The gate executes commands, within the limits."""
    HOLD = "hold"
    """Joint data is too old or not usable, or the control loop asked for a hold: the robot stops and keeps
    its position. The state ends when the cause ends."""
    STOP = "stop"
    """The robot or the program has a fault: the robot stops as in HOLD, but stays stopped until an operator
    resets the gate."""


@dataclass(frozen=True, slots=True)
class GateToken:
    """Token that proves that a gate created the `SafeCommand`."""

    robot: str
    """Name of the robot for which the gate was created."""


@dataclass(frozen=True, slots=True, eq=False)
class SafeCommand:
    """Command that may be written now. A gate creates the command for the driver of this gate, and the driver
    may write the command only once."""

    seal: object = field(repr=False)
    """Token of the gate that creates the command. Without this token the constructor raises DriverError."""
    stamp: float
    """Time [s] at which the command was created."""
    state: GateState
    """State of the gate."""
    servos: NDArray[np.intp]
    """Indices (k,) of the servos under command. A driver never sends anything to other servos."""
    modes: tuple[Mode, ...]
    """Control mode (k,) of each servo. If a servo is in another mode, the driver must switch the servo to
    this mode before the driver sends other values."""
    position: Array
    """Position (k,) [rad] of each servo. In position and velocity mode: the set-point for the end of this
    period. In impedance mode: the equilibrium. In torque mode: the measured position."""
    velocity: Array
    """Velocity (k,) [rad/s] of each servo at the end of this period; 0 in torque mode."""
    acceleration: Array
    """Acceleration (k,) [rad/s2] of each servo at the end of this period; 0 in torque mode."""
    torque: Array
    """Torque (k,) [N m] of each servo in torque mode; 0 in other modes."""
    stiffness: Mapping[int, float]
    """New stiffness of the servos that got a stiffness command in this step, by servo index: a fraction
    (0..1) of full stiffness."""
    damping: Mapping[int, float]
    """New damping of the servos that got a damping command in this step, by servo index: a fraction (0..1) of
    full damping."""
    clamped: tuple[Reason, ...]
    """Reasons for values that were clamped (code CLAMPED), for motions that were ended (code SELF_COLLISION;
    OVERTAKEN for orders that came while their part met something), and for changes of mode that wait until
    the servos rest (code SWITCHES_AT_REST)."""
    refusals: tuple[Reason, ...]
    """Reasons why commands were refused in this step."""
    reason: Reason | None = None
    """Reason for the state HOLD or STOP of the gate; None in the state RUN."""
    met: tuple[Met, ...] = ()
    """Contacts that the gate notices, or that of the robot's process, from the lower of the two thresholds
    on; one for each part."""
    orders: tuple[PlatformOrder, ...] = ()
    """Orders that were accepted in this step. A driver that is connected to another TCI process sends these
    orders to that process instead of positions, because the gate of that process plans the motion."""
    refused: tuple[tuple[PlatformOrder, Reason], ...] = ()
    """Orders that were refused in this step, each with its reason, which is in `refusals` too; in `clamped`
    if it was overtaken. A switch that waited for rest, or a command after it, may be refused later than it
    was accepted."""

    def __post_init__(self) -> None:
        if not isinstance(self.seal, GateToken):
            raise DriverError("only a gate makes a SafeCommand: use driver.gate.step(...)")
