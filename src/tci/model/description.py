"""What a robot is, as frozen types in SI units and radians. `tci.model.xml` reads them from a file.

The names follow the paper's Listing 2: a *servo* is a joint of the robot (DS in eq. 1), a *generic
servo* one joint of a generic part (GS), `scale` is gamma and `offset` sigma.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tci.errors import UnknownNameError
from tci.frames import Array, read_only, rotation_rpy, transform
from tci.messages import Mode

Vector = tuple[float, float, float]


class Words(BaseModel):
    """Base of all types here: frozen, no unknown fields, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    # Only fields count: cached arrays lie beside them, and an array has no single truth value.
    def __eq__(self, other: object) -> bool:
        return self is other or (type(self) is type(other) and self._values() == other._values())

    def __hash__(self) -> int:
        return hash(self._values())

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy, with some fields changed; it works out cached arrays anew."""
        copy = super().model_copy(update=update, deep=deep)
        for name in set(copy.__dict__) - set(type(self).model_fields):
            del copy.__dict__[name]
        return copy

    def _values(self) -> tuple[object, ...]:
        return tuple(getattr(self, name) for name in type(self).model_fields)


class Limits(Words):
    """What a servo may do. None: nobody said, so the gate refuses commands that need it."""

    lower: float | None = None
    """Smallest angle [rad]."""
    upper: float | None = None
    """Largest angle [rad]."""
    velocity: float | None = None
    """Largest speed [rad/s]."""
    acceleration: float | None = None
    """Largest acceleration [rad/s2]."""
    jerk: float | None = None
    """Largest jerk [rad/s3]."""
    torque: float | None = None
    """Largest torque [N m]."""
    ours: tuple[str, ...] = ()
    """Names of the fields above whose figure no maker published: it is ours."""


class Servo(Words):
    """A joint of the robot, in the robot's own terms."""

    index: int
    """Place in `Robot.servos`, and in every JointReading."""
    robot_part: str
    """The robot's own part, a control board of YARP or a chain of NAOqi: `LArm`, `left_arm`."""
    id: int
    """The robot's own number of the servo in that part (`destination_servo_id`)."""
    name: str
    """The robot's own name of the joint."""
    joint: str | None = None
    """Name of the joint in the kinematic model; None when it has none there."""
    limits: Limits = Limits()
    """What it may do."""
    modes: tuple[Mode, ...] = (Mode.POSITION,)
    """Control modes that it can be switched to; the first is the one it starts in."""


class Coupling(Words):
    """A linear inequality between servos: lower <= sum(coefficient * angle) <= upper."""

    name: str
    servos: tuple[int, ...]
    """Indices into `Robot.servos`."""
    coefficients: tuple[float, ...]
    lower: float
    """[rad]"""
    upper: float
    """[rad]"""


class Term(Words):
    """One servo's share in a coupled generic joint."""

    servo: int
    """Index into `Robot.servos`."""
    factor: float
    """d generic / d servo."""


class GenericServo(Words):
    """One joint of a generic part: GS = scale * DS + offset (eq. 1), or by another transform."""

    id: int
    """Index in the generic part, from 0."""
    name: str
    """Generic name: `shoulder_pitch`, or `joint0` where the file gives none."""
    servo: int | None
    """Index into `Robot.servos`; None when the robot lacks this joint."""
    scale: float = 1.0
    """gamma, the transform factor."""
    offset: float = 0.0
    """sigma [rad], the transform displacement."""
    transform: Literal["linear", "table", "coupled", "retarget"] = "linear"
    """How generic and robot's angles belong together: see `tci.model.joint_map`."""
    table: tuple[tuple[float, float], ...] = ()
    """Pairs of the servo's angle, which rises, and the generic angle [rad], for a table."""
    terms: tuple[Term, ...] = ()
    """Servos that make up the joint, its own among them, when it is coupled."""
    fixed: float = 0.0
    """Generic angle [rad] at which the robot holds a joint that it lacks."""
    stiffness: float = 1.0
    """Share 0..1 of full stiffness that `home` sets."""
    damping: float = 0.0
    """Share 0..1 of full damping that `home` sets."""
    speed: float | None = None
    """Speed [rad/s, generic] at which the part moves unless the gate's limit is lower."""
    initial: float = 0.0
    """Initial generic angle [rad]."""


class Segment(Words):
    """A piece of a limb, on which skin sits: its proximal point, its length."""

    name: str
    """`upper_arm` or `forearm`."""
    link: str
    """Link of the kinematic model that the origin is given in."""
    origin: Vector
    """Proximal end of the segment's axis (3,) [m] in `link`; u is measured from here."""
    length: float
    """Length [m]; u is 1 here."""


class GenericPart(Words):
    """A part that every humanoid has (eq. 2)."""

    name: str
    """`left_arm`, `head`, ..."""
    kind: Literal["arm", "head", "torso", "leg", "hand", "other"]
    side: Literal["left", "right"] | None = None
    servos: tuple[GenericServo, ...]
    """By generic id."""
    mount: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] of the mount frame in the torso frame: `R_TM`."""
    segments: tuple[Segment, ...] = ()

    @cached_property
    def R_TM(self) -> Array:
        """Mount frame M seen from the torso T (3, 3)."""
        return read_only(rotation_rpy(*self.mount))

    @cached_property
    def initial_posture(self) -> Array:
        """Initial generic angles (n,) [rad]."""
        return read_only([servo.initial for servo in self.servos])

    def segment(self, name: str) -> Segment:
        """The segment of that name. Raises UnknownNameError."""
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise UnknownNameError(f"segment of {self.name}", name, [s.name for s in self.segments])


class Sensor(Words):
    """How raw values become pressure: (raw - rest) * pascal_per_count, or by a response curve; at least 0."""

    rest: float
    """Raw value with nothing touching."""
    pascal_per_count: float
    """Response [Pa per count]; negative where raw falls with pressure (an iCub's skin)."""
    lowest: float
    """Smallest raw value that the sensor can send."""
    highest: float
    """Largest raw value that the sensor can send."""
    noise: float = 0.0
    """Standard deviation [counts] of its values at rest, to start with: the rest is learnt."""
    response: tuple[tuple[float, float], ...] = ()
    """Pairs of counts away from rest and pressure [Pa], both rising from 0, 0, for a sensor that is not
    linear; straight lines between them and beyond. Empty: pascal_per_count is all there is."""
    axes: Literal[1, 3] = 1
    """1: a raw value is a taxel's pressure. 3: each taxel sends x and y, the stress along the skin, and z,
    outward; a frame has three times as many values as the skin has channels."""
    shear: float | None = None
    """Response [Pa per count] of x and y, linear; None: the size of pascal_per_count."""

    @property
    def shear_pascal_per_count(self) -> float:
        """Response [Pa per count] of a three-axis taxel along the skin."""
        return abs(self.pascal_per_count) if self.shear is None else self.shear

    def pressure(self, counts: Array) -> Array:
        """Pressure [Pa] of deviations from rest [counts], positive with pressure."""
        if not self.response:
            return counts * abs(self.pascal_per_count)
        return _along(counts, *np.array(self.response).T)

    def counts(self, pressure: Array) -> Array:
        """Deviations from rest [counts] of pressures [Pa]: the inverse."""
        if not self.response:
            return pressure / abs(self.pascal_per_count)
        counts, pascal = np.array(self.response).T
        return _along(pressure, pascal, counts)


def _along(values: Array, nodes: Array, results: Array) -> Array:
    """Straight lines through points (m,), beyond the last too. Values below 0 are 0."""
    values = np.maximum(values, 0.0)
    slope = (results[-1] - results[-2]) / (nodes[-1] - nodes[-2])
    beyond = np.maximum(values - nodes[-1], 0.0) * slope
    result: Array = np.interp(values, nodes, results) + beyond
    return result


class TruncatedCone(Words):
    """Taxels on a truncated cone, ring by ring (eqs 3-4, Fig. 4)."""

    kind: Literal["truncated_cone"] = "truncated_cone"
    origin: Vector
    """Centre (3,) [m] of the cone's proximal end, in the patch's link."""
    rpy: Vector
    """Orientation [rad] of the cone's frame in the link: -z along the axis to the distal end,
    x at theta = 0."""
    length: float
    """[m]"""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rings: int
    """Rings of taxels, evenly along the axis."""
    per_ring: int
    """Taxels in each ring; every second ring is turned by half a step."""


class TriangularModules(Words):
    """Triangular modules of ten taxels (and two thermal pads), each at a frame of the model."""

    kind: Literal["triangular_modules"] = "triangular_modules"
    frames: tuple[str, ...]
    """Frame of each module in the kinematic model."""
    ports: tuple[int, ...]
    """Place of each module in the raw frame: its channels are 12 * port ... 12 * port + 11."""
    turns: tuple[float, ...] = ()
    """Angle [rad] of each module about its frame's z axis, which points outward; empty: all zero."""


class Table(Words):
    """Taxels from a file beside the description."""

    kind: Literal["table"] = "table"
    file: str
    """Absolute after loading."""
    format: Literal["rows", "icub", "csv", "urdf"] = "rows"
    """Nothing but rows x y z nx ny nz [m], a skin calibration file as iCub's are, a table with a header, or
    the tactile sensors of a URDF."""
    sensor: str | None = None
    """Which of a URDF's tactile sensors; not needed when it has one."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the file's frame in the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the file's frame in the patch's link."""


SOLE = "foot"
"""Segment of a leg whose skin stands on the ground."""


class Patch(Words):
    """A piece of skin on one link."""

    name: str
    part: str
    """Generic part it belongs to."""
    segment: str = ""
    """Segment of that part; empty for skin that is on none of its segments (head, hand, torso)."""
    link: str
    """Link of the kinematic model that carries it."""
    rate: float
    """Frames per second [Hz]."""
    channels: int
    """Values in a raw frame."""
    sensor: Sensor
    surface: Annotated[TruncatedCone | TriangularModules | Table, Field(discriminator="kind")]
    rigid: bool = False
    """Whether its taxels carry one rigid plate, as the load cells under a foot: then all that are pressed
    are one contact."""


class Model(Words):
    """Where the kinematic model is, and where the torso is in it."""

    format: Literal["urdf", "mjcf"]
    path: str
    """File, absolute after loading."""
    package: str | None = None
    """Installed Python package that the file comes from (its extra has the robot's name)."""
    torso_link: str
    """Link that the torso frame is fixed to."""
    torso_rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the torso frame (x forward, y left, z up) in that link."""
    torso_xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the torso frame in that link."""

    @cached_property
    def T_LT(self) -> Array:
        """Torso frame T seen from its link L (4, 4)."""
        return read_only(transform(rotation_rpy(*self.torso_rpy), np.array(self.torso_xyz)))


class Address(Words):
    """Where a middleware finds one thing of the robot."""

    of: str
    """Name of a patch, of a robot part or of a servo."""
    to: str
    """Its port, topic, key or name there."""


class Binding(Words):
    """How one middleware reaches the robot."""

    middleware: str
    """Name of the link: `sim`, `yarp`, `naoqi`, ..."""
    rate: float
    """Commands per second [Hz]."""
    stale_after: float
    """Age [s] beyond which joint data no longer counts, and the gate holds."""
    addresses: tuple[Address, ...] = ()
    """Things that are not found under the middleware's usual names."""

    def address(self, of: str, usual: str) -> str:
        """Where the patch, robot part or servo named `of` is found; `usual` where the file says nothing."""
        return next((address.to for address in self.addresses if address.of == of), usual)


class Robot(Words):
    """A robot: data only. Robots serve as keys, so their hash is quick; equality looks at everything."""

    name: str
    title: str = ""
    source: str
    """File it was read from."""
    digest: str
    """SHA-256 of that file: goes into every log."""
    model: Model | None = None
    servos: tuple[Servo, ...]
    """All servos, in the order of every JointReading."""
    couplings: tuple[Coupling, ...] = ()
    parts: tuple[GenericPart, ...]
    patches: tuple[Patch, ...] = ()
    bindings: tuple[Binding, ...] = ()

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    @cached_property
    def initial_position(self) -> Array:
        """Angle (n_servos,) [rad] of every servo in the initial posture (inverse of eq. 1); 0 where no
        generic part says."""
        from tci.model.joint_map import joint_map  # it needs the types above

        position = np.zeros(len(self.servos))
        for part in self.parts:
            joints = joint_map(self, part.name)
            position[joints.servos] = joints.to_robot(part.initial_posture, position)
        return read_only(position)

    @cached_property
    def coupling_rows(self) -> tuple[Array, Array, Array]:
        """All couplings at once, rows @ position within lower and upper: (m, n_servos), (m,), (m,) [rad]."""
        rows = np.zeros((len(self.couplings), len(self.servos)))
        for row, coupling in zip(rows, self.couplings, strict=True):
            row[list(coupling.servos)] = coupling.coefficients
        lower, upper = [c.lower for c in self.couplings], [c.upper for c in self.couplings]
        return read_only(rows), read_only(lower), read_only(upper)

    @cached_property
    def kept(self) -> dict[tuple[str, str], Any]:
        """What others worked out from this robot and need again in each period. Looked up here, since a
        robot as a key is compared field by field with every other one of the same file."""
        return {}

    def part(self, name: str) -> GenericPart:
        """The generic part of that name. Raises UnknownNameError."""
        for part in self.parts:
            if part.name == name:
                return part
        raise UnknownNameError("generic part", name, [part.name for part in self.parts])

    def patch(self, name: str) -> Patch:
        """The skin patch of that name. Raises UnknownNameError."""
        for patch in self.patches:
            if patch.name == name:
                return patch
        raise UnknownNameError("skin patch", name, [patch.name for patch in self.patches])

    def limb_segment(self, patch: Patch) -> Segment | None:
        """The limb segment that a patch lies on; None for skin elsewhere, which has no limb coordinates."""
        part = self.part(patch.part)
        if part.kind != "arm" or part.side is None or not patch.segment:
            return None
        return part.segment(patch.segment)

    def binding(self, middleware: str) -> Binding:
        """How that middleware reaches the robot. Raises UnknownNameError."""
        for binding in self.bindings:
            if binding.middleware == middleware:
                return binding
        raise UnknownNameError("binding", middleware, [b.middleware for b in self.bindings])

    def servos_of(self, robot_part: str) -> tuple[Servo, ...]:
        """Servos of one of the robot's own parts, by id. Raises UnknownNameError."""
        found = tuple(servo for servo in self.servos if servo.robot_part == robot_part)
        if not found:
            names = dict.fromkeys(servo.robot_part for servo in self.servos)
            raise UnknownNameError("robot part", robot_part, names)
        return found
