"""Generic parts, their joints (GS in eq. 1) and the segments of a limb (eq. 2)."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

from tci.errors import UnknownNameError
from tci.frames import Array, read_only, rotation_rpy
from tci.robot.description.base import Description, Vector

Kind = Literal["arm", "head", "torso", "leg", "hand", "fingers", "other"]
"""Kinds of generic parts: those of one kind have the same generic joints."""


class Term(Description):
    """Contribution of one servo to a coupled generic joint."""

    servo: int
    """Index into `Robot.servos`."""
    factor: float
    """d generic / d servo."""


class GenericServo(Description):
    """One joint of a generic part: GS = scale * DS + offset (eq. 1), or by another transform."""

    id: int
    """Index in the generic part, from 0."""
    name: str
    """Generic name: `shoulder_pitch`, or `joint0` where the file gives none."""
    servo: int | None
    """Index into `Robot.servos`; None when the robot lacks this joint."""
    scale: float = 1.0
    """Transform factor gamma."""
    offset: float = 0.0
    """Transform displacement sigma [rad]."""
    transform: Literal["linear", "table", "coupled", "synergy", "retarget"] = "linear"
    """Rule that relates generic angles and the robot's angles: see `tci.robot.transforms`."""
    table: tuple[tuple[float, float], ...] = ()
    """Pairs (servo angle, generic angle) [rad] of a table, in rising order of the servo angle."""
    terms: tuple[Term, ...] = ()
    """Servos whose linear combination is the angle of a coupled or synergic joint, including its own
    servo."""
    fixed: float = 0.0
    """Constant generic angle [rad] that is read for a joint that the robot lacks."""
    stiffness: float = 1.0
    """Fraction 0..1 of full stiffness that `home` sets."""
    damping: float = 0.0
    """Fraction 0..1 of full damping that `home` sets."""
    speed: float | None = None
    """Speed [rad/s] of the generic joint, unless the gate's limit is lower. For a retargeted shoulder, the
    speed of the servo itself."""
    initial: float = 0.0
    """Initial generic angle [rad]."""

    @property
    def moved(self) -> tuple[int, ...]:
        """Indices into `Robot.servos` of the servos on which its angle depends; empty if the robot lacks this
        joint."""
        if self.terms:
            return tuple(term.servo for term in self.terms)
        return () if self.servo is None else (self.servo,)

    @property
    def sense(self) -> float:
        """Sign of the transform: above 0 if the generic angle increases with its servo's angle, below 0 if it
        decreases."""
        if self.terms:
            return next((term.factor for term in self.terms if term.servo == self.servo), 0.0)
        return self.table[-1][1] - self.table[0][1] if self.table else self.scale


class Segment(Description):
    """A piece of a limb that carries skin: its proximal point and its length."""

    name: str
    """`upper_arm` or `forearm`."""
    link: str
    """Link of the kinematic model in whose frame `origin` is given."""
    origin: Vector = (0.0, 0.0, 0.0)
    """Proximal end (3,) [m] of the segment's axis in `link`; u = 0 here."""
    length: float
    """Length [m] of the segment; u = 1 at its distal end."""


class CartesianActuator(Description):
    """A point of a part whose position can be commanded (§3.1: a transformation in Cartesian space)."""

    name: str
    """Name that a `CartesianCommand` gives as its `point`: `hand`, `elbow`, ..."""
    link: str | None = None
    """Link of the kinematic model that carries the point; an arm's actuator may give a `segment` instead."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """The point [m] in `link`."""
    segment: str | None = None
    """Segment of the arm on whose axis the point lies."""
    u: float = 1.0
    """Place on that axis: 0 at the proximal end, 1 at the distal one."""
    frame: Literal["shoulder", "torso"] = "shoulder"
    """Frame of targets. `shoulder`: from the shoulder's centre, in the arm's mount frame, in arm lengths
    (upper arm plus forearm), so that equal numbers mean equal reach on every robot. `torso`: the torso frame,
    in m."""
    speed: float | None = None
    """Largest speed [m/s] of the point; None: only the joints' speed limits apply."""
    tolerance: float = 1e-3
    """Distance [m] within which a target counts as reached. Assumed: servos are hardly more accurate."""


USUAL_ACTUATORS = (
    CartesianActuator(name="hand", segment="forearm", u=1.0),
    CartesianActuator(name="elbow", segment="forearm", u=0.0),
)
"""Default Cartesian actuators of each arm with both segments. Actuators of the description with these names
replace them."""


class GenericPart(Description):
    """A part of the generic humanoid (eq. 2)."""

    name: str
    """`left_arm`, `head`, ..."""
    kind: Kind = "other"
    side: Literal["left", "right"] | None = None
    servos: tuple[GenericServo, ...]
    """Joints of the part, by generic id."""
    mount: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] of the mount frame in the torso frame: `R_TM`."""
    segments: tuple[Segment, ...] = ()
    cartesian: tuple[CartesianActuator, ...] = ()
    """Points whose position Cartesian commands can set."""

    @cached_property
    def R_TM(self) -> Array:
        """Rotation (3, 3) of the mount frame M seen from the torso T."""
        return read_only(rotation_rpy(*self.mount))

    @cached_property
    def initial_posture(self) -> Array:
        """Initial generic angles (n,) [rad]."""
        return read_only([servo.initial for servo in self.servos])

    def segment(self, name: str) -> Segment:
        """Returns the segment of that name. Raises UnknownNameError."""
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise UnknownNameError(f"segment of {self.name}", name, [s.name for s in self.segments])
