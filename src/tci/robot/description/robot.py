"""The robot as a whole, and its kinematic model."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np

from tci.errors import UnknownNameError
from tci.frames import Array, read_only, rotation_rpy, transform
from tci.robot.description.base import Description, Vector
from tci.robot.description.binding import USUAL, Binding
from tci.robot.description.part import GenericPart, Segment
from tci.robot.description.patch import Patch
from tci.robot.description.servo import Coupling, Servo


class Attachment(Description):
    """A model that is fixed to a link of the robot's model."""

    path: str
    """Path of the file (MJCF); absolute after loading."""
    link: str
    """Link of the robot's model to which it is fixed."""
    prefix: str
    """Prefix that is added to each name of that file."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of its frame in that link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of its frame in that link."""


class Model(Description):
    """The file of the kinematic model, and the torso frame in it."""

    format: Literal["urdf", "mjcf"]
    path: str
    """Path of the file; absolute after loading."""
    package: str | None = None
    """Installed Python package that contains the file (the extra that installs it has the robot's name)."""
    meshes: str | None = None
    """Folder, absolute after loading, in which meshes are searched that are not at the path in the model;
    "none" leaves all meshes out."""
    torso_link: str
    """Link to which the torso frame is fixed."""
    torso_rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the torso frame (x forward, y left, z up) in that link."""
    torso_xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the torso frame in that link."""
    attachments: tuple[Attachment, ...] = ()
    """Additional models, such as hands, for links that the robot's model lacks."""

    @cached_property
    def T_LT(self) -> Array:
        """Pose (4, 4) of the torso frame T seen from its link L."""
        return read_only(transform(rotation_rpy(*self.torso_rpy), np.array(self.torso_xyz)))


class Robot(Description):
    """Description of a robot. A robot can be a dictionary key: its hash is fast, and equality compares all
    fields."""

    name: str
    title: str = ""
    source: str
    """Path of the file from which the description was read."""
    digest: str
    """SHA-256 of that file, recorded in every log."""
    model: Model | None = None
    servos: tuple[Servo, ...]
    """All servos, in the order of every JointReading."""
    couplings: tuple[Coupling, ...] = ()
    parts: tuple[GenericPart, ...]
    patches: tuple[Patch, ...] = ()
    bindings: tuple[Binding, ...] = ()
    """Bindings in the file; `binding` also returns default bindings."""

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    @cached_property
    def coupling_rows(self) -> tuple[Array, Array, Array]:
        """All couplings as arrays: lower <= rows @ position <= upper, with shapes (m, n_servos), (m,), (m,)
        [rad]."""
        rows = np.zeros((len(self.couplings), len(self.servos)))
        for row, coupling in zip(rows, self.couplings, strict=True):
            row[list(coupling.servos)] = coupling.coefficients
        lower, upper = [c.lower for c in self.couplings], [c.upper for c in self.couplings]
        return read_only(rows), read_only(lower), read_only(upper)

    @cached_property
    def all_bindings(self) -> tuple[Binding, ...]:
        """Bindings to every middleware that can carry this robot: the file's own, then the usual ones."""
        own = {binding.middleware for binding in self.bindings}
        return *self.bindings, *(usual for name, usual in USUAL.items() if name not in own)

    def with_stale_after(self, seconds: float) -> Robot:
        """Returns this robot with another staleness limit [s] in each of its bindings."""
        patient = [one.model_copy(update={"stale_after": seconds}) for one in self.all_bindings]
        return self.model_copy(update={"bindings": tuple(patient)})

    @cached_property
    def skin(self) -> tuple[Patch, ...]:
        """Patches with taxels, which send frames; the others are felt through joints."""
        return tuple(patch for patch in self.patches if not patch.through_joints)

    def part(self, name: str) -> GenericPart:
        """Returns the generic part of that name. Raises UnknownNameError."""
        for part in self.parts:
            if part.name == name:
                return part
        raise UnknownNameError("generic part", name, [part.name for part in self.parts])

    def patch(self, name: str) -> Patch:
        """Returns the skin patch of that name. Raises UnknownNameError."""
        for patch in self.patches:
            if patch.name == name:
                return patch
        raise UnknownNameError("skin patch", name, [patch.name for patch in self.patches])

    def limb_segment(self, patch: Patch) -> Segment | None:
        """Returns the limb segment of a patch; None for a patch without limb coordinates."""
        part = self.part(patch.part)
        if part.kind != "arm" or part.side is None or not patch.segment:
            return None
        return part.segment(patch.segment)

    def binding(self, middleware: str) -> Binding:
        """Returns the binding to that middleware: the file's own, else the usual one.

        Raises UnknownNameError for a middleware that carries only robots with a binding of their own.
        """
        for binding in self.all_bindings:
            if binding.middleware == middleware:
                return binding
        valid = [binding.middleware for binding in self.all_bindings]
        raise UnknownNameError(f"binding of {self.name}", middleware, valid)

    def servos_of(self, robot_part: str) -> tuple[Servo, ...]:
        """Returns the servos of one of the robot's own parts, by id. Raises UnknownNameError."""
        found = tuple(servo for servo in self.servos if servo.robot_part == robot_part)
        if not found:
            names = dict.fromkeys(servo.robot_part for servo in self.servos)
            raise UnknownNameError("robot part", robot_part, names)
        return found
