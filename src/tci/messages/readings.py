"""What a robot measures: its joints and raw skin frames, in the robot's own order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.messages.modes import Mode


@dataclass(frozen=True, slots=True, eq=False)
class JointReading:
    """The robot's joints at one instant, in the order of `Robot.servos`."""

    stamp: float
    """Time [s] of the measurement, on the driver's clock."""
    sequence: int
    """Number that increases by one with each new reading of the robot."""
    position: Array
    """Angles (n,) [rad]."""
    velocity: Array
    """Velocities (n,) [rad/s]."""
    torque: Array | None = None
    """Torques (n,) [N m] of the joints; None if the robot does not report them."""
    modes: tuple[Mode | None, ...] | None = None
    """Control mode (n,) that each servo reports, or None for a servo with an unknown mode. None in place of
    the tuple if the robot reports no modes."""
    powered: NDArray[np.bool_] | None = None
    """True (n,) for each servo that is switched on; None if the robot does not report this."""
    gravity: Array | None = None
    """Gravity minus the acceleration of the root link of the robot's model: a vector (3,) [m/s2] in the frame
    of that link. An accelerometer on that link measures the negative of this vector. The value is None if the
    robot does not report it."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinFrame:
    """One frame of one patch, with the raw values that the robot sent."""

    patch: str
    """Name of the patch in the robot's description."""
    stamp: float
    """Time [s] of the measurement, on the driver's clock."""
    sequence: int
    """Number that increases by one with each new frame of the patch."""
    values: NDArray[np.generic]
    """Raw values (channels,), in the sensor's own units and order."""

    @property
    def empty(self) -> bool:
        """True if no channel has a value, as while a source is silent."""
        return self.values.dtype.kind == "f" and bool(np.isnan(self.values).all())


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The latest data of one robot: its joints and one frame of every patch."""

    joints: JointReading
    """Latest joint reading."""
    skin: tuple[SkinFrame, ...]
    """Latest frame of each patch that has sent a frame."""
