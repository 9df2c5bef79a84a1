"""Generic parts, their joints (GS in eq. 1) and the segments of a limb (eq. 2)."""

from __future__ import annotations

import math
from functools import cached_property
from math import acos, radians
from typing import Literal

import numpy as np

from tci.errors import UnknownNameError
from tci.messages.frames import Array, read_only, rotation_rpy
from tci.robot.description.base import Description, Vector

MAX_MOUNT = radians(20.0)
"""Largest rotation [rad] of a mount on a torso. Assumed: there it is only a small correction, and a shoulder
that differs more from the generic one must be retargeted. An arm that is alone may be mounted in any way."""
Kind = Literal["arm", "head", "torso", "leg", "hand", "fingers", "other"]
"""Kinds of generic parts. Parts of one kind have the same generic joints."""


class Term(Description):
    """Contribution of one servo to the angle of a coupled generic joint."""

    servo: int
    """Index into `Robot.servos`."""
    factor: float
    """Derivative of the generic angle with respect to the servo angle."""


class GenericServo(Description):
    """One joint of a generic part. The transform gives its angle GS, for example GS = scale * DS + offset
    (eq. 1) with the servo angle DS."""

    id: int
    """Index in the generic part, from 0."""
    name: str
    """Generic name of the joint, such as `shoulder_pitch`; `joint0` and so on if the file contains no
    name."""
    servo: int | None
    """Index into `Robot.servos`; None if the robot lacks this joint."""
    scale: float = 1.0
    """Factor gamma of eq. 1: change of the generic angle per change of the servo's angle."""
    offset: float = 0.0
    """Displacement sigma [rad] of eq. 1: generic angle while the servo is at 0."""
    transform: Literal["linear", "table", "coupled", "synergy", "retarget"] = "linear"
    """Kind of transform between generic and servo angles. "linear" and "table" use one servo, "coupled" and
    "synergy" linear combinations of several servos, "retarget" the servos of a shoulder."""
    table: tuple[tuple[float, float], ...] = ()
    """Pairs (servo angle, generic angle) [rad] of the transform `table`, in rising order of the servo
    angle."""
    terms: tuple[Term, ...] = ()
    """Servos and factors of a coupled or synergic joint: the joint's angle is a linear combination of the
    angles of these servos. The joint's own servo must be among these servos."""
    fixed: float = 0.0
    """Constant generic angle [rad] that is reported if the robot lacks this joint."""
    stiffness: float = 1.0
    """Stiffness that `GenericBody.home` sets, as a fraction 0..1 of full stiffness."""
    damping: float = 0.0
    """Damping that the command `home` sets, as a fraction 0..1 of full damping."""
    speed: float | None = None
    """Speed [rad/s] at which the generic joint moves, unless the gate's limit is lower. With None, only the
    gate's limit applies. In a retargeted shoulder, the value limits the servo in the field `servo` in
    position mode, and the generic joint in velocity mode."""
    initial: float = 0.0
    """Initial generic angle [rad]."""

    @property
    def moved(self) -> tuple[int, ...]:
        """Indices into `Robot.servos` of the servos on which the generic angle depends; empty if the robot
        lacks this joint."""
        if self.terms:
            return tuple(term.servo for term in self.terms)
        return () if self.servo is None else (self.servo,)

    @property
    def sense(self) -> float:
        """Sign of the transform: above 0 if the generic angle increases with the angle of its servo, below 0
        if it decreases."""
        if self.terms:
            return next((term.factor for term in self.terms if term.servo == self.servo), 0.0)
        return self.table[-1][1] - self.table[0][1] if self.table else self.scale


class Segment(Description):
    """A part of a limb that carries skin, given by its proximal point and its length."""

    name: str
    """Name of the segment, for example `upper_arm`, `forearm` or `thigh`."""
    link: str
    """Link of the kinematic model. `origin` is given in the frame of this link."""
    origin: Vector = (0.0, 0.0, 0.0)
    """Proximal end (3,) [m] of the segment's axis, in the frame of `link`. The limb coordinate u is 0 at this
    end."""
    length: float
    """Length [m] of the segment. The limb coordinate u is 1 at the segment's distal end."""


FOV = math.radians(48.0)
"""Angle of view [rad] where a description tells none: that of common cameras with 4:3 pictures. Assumed."""


class Eyes(Description):
    """Where a head looks from. It looks along the torso frame's x axis when its generic angles are zero."""

    link: str
    """Link of the kinematic model that carries the eyes or cameras."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Position (3,) [m] of the point between them, in the frame of `link`."""
    fov: float = FOV
    """Vertical angle of view [rad] of the camera."""
    pitch: float = 0.0
    """Angle [rad] by which the camera looks down from there."""


class CartesianActuator(Description):
    """A point of a generic part whose position can be commanded (§3.1 of the paper)."""

    name: str
    """Name of the point in a `CartesianCommand`: `hand`, `elbow`, ..."""
    link: str | None = None
    """Link of the kinematic model that carries the point. For an actuator of an arm, the field `segment` can
    be set instead of `link`."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Position (3,) [m] of the point in the frame of `link`."""
    segment: str | None = None
    """Segment of the arm on whose axis the point is. Without a segment, `link` and `xyz` give the point."""
    u: float = 1.0
    """Place of the point on the segment's axis: 0 at the proximal end, 1 at the distal end."""
    frame: Literal["shoulder", "torso"] = "shoulder"
    """Frame of the target positions. `shoulder`: position relative to the centre of the shoulder, in the
    arm's mount frame, in arm lengths (upper arm plus forearm). With this frame, one target means one fraction
    of the arm's reach on every robot. `torso`: position in the torso frame, in m."""
    speed: float | None = None
    """Largest speed [m/s] of the point. If None, only the speed limits of the joints apply."""
    tolerance: float = 1e-3
    """A target counts as reached if the point is within this distance [m]. Assumed: servos can hardly
    position the point more accurately than this distance."""


USUAL_ACTUATORS = (
    CartesianActuator(name="hand", segment="forearm", u=1.0),
    CartesianActuator(name="elbow", segment="forearm", u=0.0),
)
"""Default Cartesian actuators of each arm that has both segments. An actuator in the description with one of
these names replaces the default."""


class GenericPart(Description):
    """A part of the generic humanoid, such as an arm or the head (eq. 2)."""

    name: str
    """Name of the part, for example `left_arm` or `head`."""
    kind: Kind = "other"
    side: Literal["left", "right"] | None = None
    servos: tuple[GenericServo, ...]
    """Joints of the part, by generic id."""
    mount: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw [rad] of the mount frame in the torso frame. `R_TM` is the matrix of this
    rotation."""
    segments: tuple[Segment, ...] = ()
    cartesian: tuple[CartesianActuator, ...] = ()
    """Points of this part for which Cartesian commands can set a position."""
    eyes: Eyes | None = None
    """Where a head looks from; None if the description doesn't tell."""

    @cached_property
    def R_TM(self) -> Array:
        """Rotation (3, 3) of the mount frame M in the torso frame T."""
        return read_only(rotation_rpy(*self.mount))

    @cached_property
    def stands_alone(self) -> bool:
        """True for an arm on a table, wall or ceiling: its mount is turned as no shoulder on a torso is. At
        generic zero it does not hang, but is stretched out square to its first axis."""
        return acos(min(1.0, max(-1.0, (float(np.trace(self.R_TM)) - 1.0) / 2.0))) > MAX_MOUNT + 1e-9

    @cached_property
    def initial_posture(self) -> Array:
        """Initial generic angles (n,) [rad]."""
        return read_only([servo.initial for servo in self.servos])

    def segment(self, name: str) -> Segment:
        """Returns the segment with this name. Raises UnknownNameError if the part has no such segment."""
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise UnknownNameError(f"segment of {self.name}", name, [s.name for s in self.segments])
