"""What a capability asks for, in generic joints, and what the gate checks, in the robot's own joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import CommandError
from tci.messages.frames import Array, read_only
from tci.messages.modes import Mode, ModeLike


def _take_mode(command: GenericCommand | SwitchMode | PlatformSwitch | PlatformCommand) -> None:
    """Replaces the mode's name in a command, such as "position", by the `Mode`. Raises UnknownNameError for
    an unknown name."""
    if not isinstance(command.mode, Mode):
        object.__setattr__(command, "mode", Mode.of(command.mode))


@dataclass(frozen=True, slots=True, eq=False)
class GenericCommand:
    """What a generic part should do next. A later command to the part replaces it."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """Quantity and unit of `values`."""
    values: Array
    """One value per generic joint (n,)."""
    speed: Array | float | None = None
    """Speed [rad/s] that no generic joint may exceed on its way, also in velocity mode: one number for all
    joints, or one per joint (n,), above 0. References use 85 % of it, because joints overshoot. None leaves
    the speeds of the description. Not in torque mode, where nothing plans the way."""

    if TYPE_CHECKING:  # what it takes; the fields are what it keeps

        def __init__(
            self, part: str, mode: ModeLike, values: ArrayLike, speed: ArrayLike | None = None
        ) -> None: ...

    def __post_init__(self) -> None:
        _take_mode(self)
        _take_numbers(self, "values", self.mode.value)
        if self.speed is not None:
            _take_numbers(self, "speed", "speed")


def _take_numbers(command: GenericCommand | CartesianCommand, name: str, what: str) -> None:
    """Replaces a number or a sequence in a command by a read-only array. Raises CommandError if it contains
    anything else than numbers."""
    numbers = getattr(command, name)
    if not isinstance(numbers, np.ndarray):
        try:
            object.__setattr__(command, name, read_only(numbers))
        except (TypeError, ValueError) as error:
            raise CommandError(f"{what} of {command.part}: {error}; valid: numbers") from error


@dataclass(frozen=True, slots=True, eq=False)
class CartesianCommand:
    """Target position of a Cartesian actuator: a point of the robot, for example of a hand. TCI computes the
    target angles of the part's joints, and moves the joints in position mode (§3.1 of the paper)."""

    part: str
    """Name of the generic part."""
    target: Array
    """Target position (3,). For an actuator with the frame `shoulder`, such as `hand` and `elbow`: [arm
    lengths] from the shoulder, in the arm's mount frame. For other actuators: [m], in the torso frame."""
    point: str = "hand"
    """Name of the actuator: `hand` or `elbow` of an arm, or the name of an actuator in the description."""
    nearest: bool = False
    """If the target is out of reach: True moves the point to the nearest reachable place, False refuses the
    command."""
    speed: Array | float | None = None
    """Speed [rad/s] that no generic joint may exceed, as in `GenericCommand`."""

    if TYPE_CHECKING:

        def __init__(
            self,
            part: str,
            target: ArrayLike,
            point: str = "hand",
            nearest: bool = False,
            speed: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        _take_numbers(self, "target", "target")
        if self.speed is not None:
            _take_numbers(self, "speed", "speed")


@dataclass(frozen=True, slots=True, eq=False)
class SwitchMode:
    """A capability's request to switch a generic part to another control mode. Other commands never switch
    modes."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """Requested mode: position, velocity, torque or impedance."""

    if TYPE_CHECKING:

        def __init__(self, part: str, mode: ModeLike) -> None: ...

    def __post_init__(self) -> None:
        _take_mode(self)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectContact:
    """Declares contact that the capability itself handles, such as a hug, a hand that it holds, or somebody
    who guides an arm: up to `force` the gate leaves the part to the capability.

    It expires after half a second, so give it in each step; the gate answers all contact above the force, and
    all contact that no skin feels, as ever.
    """

    part: str
    """Name of the generic part."""
    force: float
    """Largest force [N] on the part's skin, 0 to 65 N, the least limit of ISO/TS 15066. 0 declares none."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.force <= MOST_EXPECTED:
            raise CommandError(
                f"expected contact of {self.part}: {self.force} N; valid: 0 to {MOST_EXPECTED:g} N"
            )


MOST_EXPECTED = 65.0
"""Largest force [N] that an `ExpectContact` may declare: what ISO/TS 15066 permits on the most sensitive
region that may be touched at all, the face."""


@dataclass(frozen=True, slots=True, eq=False)
class PlatformSwitch:
    """A request to switch the robot's own servos to another control mode."""

    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    mode: Mode
    """Requested mode: position, velocity, torque or impedance."""

    def __post_init__(self) -> None:
        _take_mode(self)


@dataclass(frozen=True, slots=True, eq=False)
class PlatformCommand:
    """A command to servos, in the robot's own joint angles. If it was converted from generic joints, it
    contains only servos that move these joints."""

    mode: Mode
    """Quantity and unit of `values`."""
    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    values: Array
    """One value per servo (k,), in the unit of the mode."""
    speed: Array
    """Upper bound (k,) [rad/s] of each servo's speed. The gate also applies the speed limit of the servo
    itself."""

    def __post_init__(self) -> None:
        _take_mode(self)


Command = GenericCommand | CartesianCommand | SwitchMode | ExpectContact
"""Types of command that a capability may return."""
PlatformOrder = PlatformCommand | PlatformSwitch
"""Types of order that the gate checks: commands in the robot's own joints, and requests to switch their
control mode."""
Order = Command | PlatformOrder
"""Types of order that a capability, or another program through a server, may give."""
