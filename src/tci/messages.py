"""All messages between layers: frozen, with read-only arrays, in SI units and radians.

Data flows one way (docs/architecture.md):

    Reading(JointReading, SkinFrame...)   robot -> interface       raw, in the robot's own order
    SkinState                             skin                     pressure [Pa] of the active taxels
    Contacts                              skin/contacts            eq. 7
    Perception                            interface -> capability  generic posture and contacts
    GenericCommand, SwitchMode            capability -> interface  generic joints, tagged with its mode
    PlatformCommand, PlatformSwitch       body/posture             inverse of eqs 1-2, mapped servos only
    SafeCommand                           gate                     all that a driver writes
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tci.contacts import Contact as Contact
from tci.contacts import Contacts as Contacts
from tci.contacts import Frozen
from tci.contacts import Site as Site
from tci.errors import CommandError, UnknownNameError
from tci.frames import Array, read_only
from tci.records import quick


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


CONTROL_MODES = (Mode.POSITION, Mode.VELOCITY, Mode.TORQUE, Mode.IMPEDANCE)
"""Control modes of a servo; exactly one of them is active at a time. Stiffness and damping can be set in each
control mode."""


@quick
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


@quick
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


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The latest data of one robot: its joints and one frame of every patch."""

    joints: JointReading
    """Latest joint reading."""
    skin: tuple[SkinFrame, ...]
    """Latest frame of each patch that has sent a frame."""


@quick
@dataclass(frozen=True, slots=True, eq=False)
class SkinState(Frozen):
    """Pressure on the whole skin at one instant. A `SkinState` lists only active taxels, which are those
    above their threshold."""

    taxels: NDArray[np.int64]
    """Index (p + 1,) of each patch's first taxel within the whole skin, in the robot's order; the last
    element is the number of taxels."""
    stamp: Array
    """Time (p,) [s] of each patch's latest frame; NaN before the first frame."""
    sequence: NDArray[np.int64]
    """Sequence number (p,) of each patch's latest frame; -1 before the first frame."""
    begin: NDArray[np.int64]
    """Index (p + 1,) of each patch's first active taxel in the arrays of active taxels (k,); the last element
    is k."""
    active: NDArray[np.int32]
    """Index (k,) of each active taxel within its patch: patch by patch, and in increasing order on each
    patch."""
    pressure: Array
    """Pressure (k,) [Pa] on each active taxel, positive."""
    vector: Array | None = None
    """Force (k, 3) [N] on each active taxel, in the frame of the patch's link; None if the taxels do not
    measure three axes."""
    masked: NDArray[np.bool_] | None = None
    """True (n,) for each taxel of the whole skin that is masked, so that its values are ignored; None if no
    taxel is masked."""

    def on(self, patch: int) -> Array:
        """Returns the pressure (taxels,) [Pa] on all taxels of one patch; 0 for taxels that are not
        active."""
        own = slice(*self.begin[patch : patch + 2].tolist())
        pressure = np.zeros(self.taxels[patch + 1] - self.taxels[patch])
        pressure[self.active[own]] = self.pressure[own]
        return read_only(pressure)

    def by_patch(self, names: Iterable[str]) -> dict[str, Array]:
        """Returns a dictionary from the name of each patch that has sent a frame to the pressures (taxels,)
        [Pa] on its taxels.

        `names` (p,) contains the names of all patches, in the robot's order.
        """
        return {name: self.on(p) for p, name in enumerate(names) if not np.isnan(self.stamp[p])}


@dataclass(frozen=True, slots=True)
class Landmark:
    """A point on the skin of a part, defined for any robot. A ray begins in the middle of the part's skin and
    goes in a given direction; the landmark is the point at which the ray reaches the skin."""

    segment: str
    """Segment of the part that carries the skin; empty for skin without a segment."""
    towards: tuple[float, float, float]
    """Direction (3,) of the ray from the middle of the part's skin to the landmark, while the part's generic
    joints are at zero: x forward, y left (for parts of the right side: right), z up."""


@dataclass(frozen=True, slots=True)
class LimbPlace:
    """A point on the skin of a limb, defined for any robot by coordinates on the generic limb (eq. 4)."""

    segment: str
    """Segment of the part: `upper_arm`, `forearm`."""
    u: float
    """Position along the segment: 0 at the proximal joint, 1 at the distal joint."""
    theta: float
    """Angle around the segment [rad]: 0 flexor, +pi/2 lateral, pi extensor, -pi/2 medial."""


@dataclass(frozen=True, slots=True)
class Support:
    """Predicted static stability of a standing robot after a motion of one leg."""

    forces: Mapping[str, float]
    """Present force [N] on the soles of each leg, by the name of the leg's part."""
    margin: float
    """Distance [m] of the centre of mass, projected along the normal of the support polygon, from the edge of
    the polygon. The distance is positive inside and negative outside. The corners of the polygon are on the
    loaded soles of all legs except the moved leg. If no such sole is loaded, if these soles span no area, or
    if the model has no masses, the value is -inf."""


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """All data that a capability gets at one instant. A perception is plain data with the same form for every
    robot.

    Methods of `GenericBody` compute results that depend on the robot.
    """

    stamp: float
    """Present time [s], on the driver's clock."""
    posture: Mapping[str, Array]
    """Generic joint angles (n,) [rad] of each generic part, by name (eqs. 1-2)."""
    contacts: Contacts
    """Contacts in the latest frames of the skin."""
    ended: tuple[int, ...] = ()
    """Identities of contacts that ended since the previous perception."""
    skin: SkinState | None = None
    """Pressure on the whole skin; None if the perception was created without a robot."""
    joints: JointReading | None = None
    """The robot's own joints, for the methods of `GenericBody`. A capability that reads these joints directly
    does not run on every robot. The value is None if the perception was created without a robot."""


def _take_mode(command: GenericCommand | SwitchMode | PlatformSwitch | PlatformCommand) -> None:
    """Replaces the mode's name in a command, such as "position", by the `Mode`. Raises UnknownNameError for
    an unknown name."""
    if not isinstance(command.mode, Mode):
        object.__setattr__(command, "mode", Mode.of(command.mode))


@quick
@dataclass(frozen=True, slots=True, eq=False)
class GenericCommand:
    """A capability's command to a generic part."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """Quantity and unit of `values`."""
    values: Array
    """One value per generic joint (n,)."""

    def __post_init__(self) -> None:
        _take_mode(self)
        if not isinstance(self.values, np.ndarray):
            try:
                object.__setattr__(self, "values", read_only(self.values))
            except (TypeError, ValueError) as error:
                raise CommandError(f"{self.mode.value} of {self.part}: {error}; valid: numbers") from error


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


@dataclass(frozen=True, slots=True, eq=False)
class SwitchMode:
    """A capability's request to switch a generic part to another control mode. Other commands never switch
    modes."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """Requested mode: position, velocity, torque or impedance."""

    def __post_init__(self) -> None:
        _take_mode(self)


@dataclass(frozen=True, slots=True, eq=False)
class PlatformSwitch:
    """A request to switch the robot's own servos to another control mode."""

    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    mode: Mode
    """Requested mode: position, velocity, torque or impedance."""

    def __post_init__(self) -> None:
        _take_mode(self)


@quick
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


Command = GenericCommand | CartesianCommand | SwitchMode
"""Types of command that a capability may return."""
PlatformOrder = PlatformCommand | PlatformSwitch
"""Types of order that the gate checks: commands in the robot's own joints, and requests to switch their
control mode."""
Order = Command | PlatformOrder
"""Types of order that a capability, or another program through a server, may give."""
