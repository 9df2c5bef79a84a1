"""What crosses a layer: frozen, with read-only arrays, in SI units and radians.

One way for the data (docs/architecture.md):

    Reading(JointReading, SkinFrame...)   robot -> interface       raw, in the robot's own order
    SkinState                             skin                     pressure [Pa] of the active taxels
    Contacts                              skin/contacts            eq. 7
    Perception                            interface -> capability  generic posture and contacts
    GenericCommand, SwitchMode            capability -> interface  generic joints, tagged with its mode
    PlatformCommand, PlatformSwitch       body/posture             inverse of eqs 1-2, mapped servos only
    SafeCommand                           gate                     the only thing that a link writes
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


class Mode(Enum):
    """What the numbers of a command are."""

    POSITION = "position"
    """Joint angles [rad]."""
    VELOCITY = "velocity"
    """Joint velocities [rad/s]."""
    TORQUE = "torque"
    """Joint torques [N m]."""
    IMPEDANCE = "impedance"
    """Equilibrium angles [rad] of a compliant joint."""
    STIFFNESS = "stiffness"
    """Share 0..1 of the servo's full stiffness."""
    DAMPING = "damping"
    """Share 0..1 of the servo's full damping."""

    @classmethod
    def of(cls, mode: Mode | str) -> Mode:
        """Returns a mode, or the mode of that name. Raises UnknownNameError."""
        if isinstance(mode, Mode):
            return mode
        names = {one.value: one for one in cls}
        if not isinstance(mode, str) or mode.lower() not in names:
            raise UnknownNameError("mode", str(mode), names)
        return names[mode.lower()]


CONTROL_MODES = (Mode.POSITION, Mode.VELOCITY, Mode.TORQUE, Mode.IMPEDANCE)
"""Modes that a servo can be in, one at a time. Stiffness and damping are settings in any of them."""


@dataclass(frozen=True, slots=True, eq=False)
class JointReading:
    """The robot's joints at one instant, in the order of `Robot.servos`."""

    stamp: float
    """When it was measured [s], on the driver's clock."""
    sequence: int
    """Counts up by one with each new reading of the robot."""
    position: Array
    """Angles (n,) [rad]."""
    velocity: Array
    """Velocities (n,) [rad/s]."""
    torque: Array | None = None
    """Torques (n,) [N m] of the joints; None where the robot does not say."""
    modes: tuple[Mode | None, ...] | None = None
    """Control mode (n,) that each servo reports; None where the robot does not say."""
    powered: NDArray[np.bool_] | None = None
    """Whether each servo (n,) is on; None where the robot does not say."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinFrame:
    """One frame of one patch, as the robot sent it."""

    patch: str
    """Name of the patch in the robot's description."""
    stamp: float
    """When it was measured [s], on the driver's clock."""
    sequence: int
    """Counts up by one with each new frame of the patch."""
    values: NDArray[np.generic]
    """Raw values (channels,), in the sensor's own numbers and order."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """All that a link knows now: the latest joints and the latest frame of every patch."""

    joints: JointReading
    """Latest joint reading."""
    skin: tuple[SkinFrame, ...]
    """Latest frame of each patch that has sent one."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinState(Frozen):
    """Pressure on the whole skin at one instant, sparse: only taxels above their threshold are listed."""

    taxels: NDArray[np.int64]
    """Start of each patch's taxels among those of the whole skin (p + 1,), in the robot's order."""
    stamp: Array
    """Time (p,) [s] of each patch's latest frame; NaN before the first."""
    sequence: NDArray[np.int64]
    """Sequence (p,) of that frame; -1 before the first."""
    begin: NDArray[np.int64]
    """Start of each patch's active taxels (p + 1,)."""
    active: NDArray[np.int32]
    """Index (k,) of each active taxel within its patch, rising."""
    pressure: Array
    """Pressure (k,) [Pa] on it, positive."""
    vector: Array | None = None
    """Force (k, 3) [N] on it, in the patch's link; None without three-axis sensors."""
    masked: NDArray[np.bool_] | None = None
    """Taxels (n,) of the whole skin that are not trusted; None if there are none."""

    def on(self, patch: int) -> Array:
        """Pressure (taxels,) [Pa] on all taxels of one patch, the inactive ones too."""
        own = slice(*self.begin[patch : patch + 2].tolist())
        pressure = np.zeros(self.taxels[patch + 1] - self.taxels[patch])
        pressure[self.active[own]] = self.pressure[own]
        return read_only(pressure)

    def by_patch(self, names: Iterable[str]) -> dict[str, Array]:
        """Pressure (taxels,) [Pa] on each patch that has sent a frame, by its name; `names` (p,) are all."""
        return {name: self.on(p) for p, name in enumerate(names) if not np.isnan(self.stamp[p])}


@dataclass(frozen=True, slots=True)
class Landmark:
    """A point of a part's skin on any robot: where one comes from the skin's middle in a direction."""

    segment: str
    """Segment of the part whose skin is meant; empty for all that is on no segment."""
    towards: tuple[float, float, float]
    """Direction (3,) with the part's generic joints at zero: x forward, y left (on a right side right), z
    up."""


@dataclass(frozen=True, slots=True)
class LimbPlace:
    """A point of a limb's skin on any robot, by its coordinates on the generic limb (eq. 4)."""

    segment: str
    """Segment of the part: `upper_arm`, `forearm`."""
    u: float
    """Place along the segment: 0 at its proximal, 1 at its distal joint."""
    theta: float
    """Angle around the segment [rad]: 0 flexor, +pi/2 lateral, pi extensor, -pi/2 medial."""


@dataclass(frozen=True, slots=True)
class Support:
    """What would carry a standing robot if one of its legs moved."""

    forces: Mapping[str, float]
    """What the soles of each leg feel now [N], by part."""
    margin: float
    """How far [m] inside the soles of the other legs that feel weight its centre of mass would be, seen along
    them: negative outside, -inf where there are none, or the model has no masses."""


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """Everything a capability perceives at one instant. Plain data of the same form for every robot.

    Questions about it that need the robot are answered by `GenericBody`.
    """

    stamp: float
    """Time now [s], on the driver's clock."""
    posture: Mapping[str, Array]
    """Generic joint angles (n,) [rad] of each generic part, by name (eqs. 1-2)."""
    contacts: Contacts
    """Contacts in the latest frames of the skin."""
    ended: tuple[int, ...] = ()
    """Identities of contacts that were in the previous perception and are gone."""
    skin: SkinState | None = None
    """Pressure on the whole skin; None where a perception was made without a robot."""
    joints: JointReading | None = None
    """The robot's own joints, for the methods of `GenericBody`; a capability that reads them here is not
    generic. None where a perception was made without a robot."""


def _take_mode(command: GenericCommand | SwitchMode | PlatformSwitch | PlatformCommand) -> None:
    """Lets a command have its mode by name, as in "position". Raises UnknownNameError."""
    if not isinstance(command.mode, Mode):
        object.__setattr__(command, "mode", Mode.of(command.mode))


@dataclass(frozen=True, slots=True, eq=False)
class GenericCommand:
    """What a capability wants a generic part to do."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """What `values` are."""
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
    """Where a point of an arm should be, in position mode (§3.1: a transformation in Cartesian space)."""

    part: str
    """Name of the generic part, an arm."""
    target: Array
    """Place (3,) relative to the shoulder, in the arm's mount frame, in arm lengths."""
    point: str = "hand"
    """`hand`, the forearm's distal end, or `elbow`."""
    nearest: bool = False
    """Whether a target out of reach means the nearest place; otherwise it is refused."""


@dataclass(frozen=True, slots=True, eq=False)
class SwitchMode:
    """A capability's request to control a generic part in another mode. Nothing else changes a mode."""

    part: str
    """Name of the generic part."""
    mode: Mode
    """One of CONTROL_MODES."""

    def __post_init__(self) -> None:
        _take_mode(self)


@dataclass(frozen=True, slots=True, eq=False)
class PlatformSwitch:
    """The same for the robot's own joints."""

    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    mode: Mode
    """One of CONTROL_MODES."""

    def __post_init__(self) -> None:
        _take_mode(self)


@dataclass(frozen=True, slots=True, eq=False)
class PlatformCommand:
    """The same in the robot's own joints; no joint is named that the part does not map."""

    mode: Mode
    """What `values` are."""
    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    values: Array
    """One value per servo (k,), in the unit of the mode."""
    speed: Array
    """Speed limit (k,) [rad/s] asked for by the description; the gate's limit holds beside it."""

    def __post_init__(self) -> None:
        _take_mode(self)


Command = GenericCommand | CartesianCommand | SwitchMode
"""What a capability may want."""
PlatformOrder = PlatformCommand | PlatformSwitch
"""What the gate takes."""
Order = Command | PlatformOrder
"""What may come from a capability or, through a server, from other programs."""
