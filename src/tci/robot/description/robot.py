"""The description of a whole robot, and of its kinematic model."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np

from tci.errors import UnknownNameError
from tci.messages.frames import Array, read_only, rotation_rpy, transform
from tci.robot.description.base import Description, Vector
from tci.robot.description.binding import USUAL, Binding
from tci.robot.description.part import GenericPart, Segment
from tci.robot.description.patch import Patch
from tci.robot.description.servo import Coupling, Servo

Mount = Literal["table", "wall", "ceiling"]
"""Flat fixed body on which the base of one arm is mounted."""


class Attachment(Description):
    """An additional model that is fixed to a link of the robot's model."""

    path: str
    """Path of the MJCF file of the additional model. After loading, the path is absolute."""
    link: str
    """Link of the robot's model to which the additional model is fixed."""
    prefix: str
    """Prefix that is put before each name of the additional model."""
    replaces: str | None = None
    """Fixed link of the robot's model, such as a rubber hand, whose shapes and mass this model replaces."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the additional model's frame, in the frame of the link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw [rad] of the additional model's frame, in the frame of the link."""


class Model(Description):
    """The file of the kinematic model, and the torso frame in this model."""

    format: Literal["urdf", "mjcf"]
    path: str
    """Path of the file. After loading, the path is absolute."""
    package: str | None = None
    """Installed Python package that contains the file. The attribute `extra` names the extra of TCI that
    installs this package."""
    meshes: str | None = None
    """Folder of the meshes that are not at the paths given in the model file. After loading, the path is
    absolute. "none": the model is read without its meshes."""
    radians: bool = False
    """True: the angles of an MJCF that does not tell their unit are in radians, not degrees, as those of a
    part for a scene in radians."""
    torso_link: str
    """Link to which the torso frame is fixed."""
    torso_rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw [rad] of the torso frame (x forward, y left, z up), in the frame of the torso
    link."""
    torso_xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the torso frame, in the frame of the torso link."""
    stands_on: Mount | None = None
    """What carries one arm, which must not hit it; None if this is not flat and wide, such as a post or a
    mobile base, or not told."""
    stands_at: float = 0.0
    """Place [m] of this body's surface from the torso frame's origin: upwards for a table and a ceiling,
    forward for a wall."""
    attachments: tuple[Attachment, ...] = ()
    """Additional models, such as hands, that contain links which the robot's model lacks."""

    @cached_property
    def T_LT(self) -> Array:
        """Pose (4, 4) of the torso frame T in the frame of its link L."""
        return read_only(transform(rotation_rpy(*self.torso_rpy), np.array(self.torso_xyz)))


class Robot(Description):
    """Description of a robot. A robot can be used as a dictionary key: its hash is fast, and two robots are
    equal if all fields are equal."""

    name: str
    title: str = ""
    source: str
    """Path of the file from which the description was read."""
    digest: str
    """SHA-256 of the description's files, recorded in every log."""
    model: Model | None = None
    servos: tuple[Servo, ...]
    """All servos of the robot, in the order in which every JointReading lists them."""
    couplings: tuple[Coupling, ...] = ()
    parts: tuple[GenericPart, ...]
    patches: tuple[Patch, ...] = ()
    bindings: tuple[Binding, ...] = ()
    """Bindings that the file contains. The method `binding` also returns default bindings."""

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    def __repr__(self) -> str:
        parts = ", ".join(part.name for part in self.parts)
        skin = ", ".join(patch.name for patch in self.skin) or "nothing"
        return f"Robot({self.name!r}: {len(self.servos)} servos; {parts}; skin on {skin})"

    __str__ = __repr__

    @cached_property
    def coupling_rows(self) -> tuple[Array, Array, Array]:
        """All couplings as three arrays: rows (m, n_servos), lower (m,) [rad] and upper (m,) [rad]. The
        condition of the couplings is lower <= rows @ position <= upper."""
        rows = np.zeros((len(self.couplings), len(self.servos)))
        for row, coupling in zip(rows, self.couplings, strict=True):
            row[list(coupling.servos)] = coupling.coefficients
        lower, upper = [c.lower for c in self.couplings], [c.upper for c in self.couplings]
        return read_only(rows), read_only(lower), read_only(upper)

    @cached_property
    def all_bindings(self) -> tuple[Binding, ...]:
        """Bindings to every middleware through which this robot can be reached: first the bindings in the
        file, then the default bindings."""
        own = {binding.middleware for binding in self.bindings}
        return *self.bindings, *(usual for name, usual in USUAL.items() if name not in own)

    def with_stale_after(self, seconds: float) -> Robot:
        """Returns this robot with another age limit [s] of joint data in each of its bindings."""
        patient = [one.model_copy(update={"stale_after": seconds}) for one in self.all_bindings]
        return self.model_copy(update={"bindings": tuple(patient)})

    @cached_property
    def skin(self) -> tuple[Patch, ...]:
        """Patches with taxels, which send frames. Touches on all other patches are detected from the torques
        of joints."""
        return tuple(patch for patch in self.patches if not patch.through_joints)

    @cached_property
    def switches(self) -> frozenset[str]:
        """Names of the patches whose taxels only tell pressed or not."""
        return frozenset(patch.name for patch in self.patches if patch.sensor.switch)

    def part(self, name: str) -> GenericPart:
        """Returns the generic part with this name. Raises UnknownNameError if the robot has no such part."""
        for part in self.parts:
            if part.name == name:
                return part
        raise UnknownNameError("generic part", name, [part.name for part in self.parts])

    def patch(self, name: str) -> Patch:
        """Returns the skin patch with this name. Raises UnknownNameError if the robot has no such patch."""
        for patch in self.patches:
            if patch.name == name:
                return patch
        raise UnknownNameError("skin patch", name, [patch.name for patch in self.patches])

    def limb_segment(self, patch: Patch) -> Segment | None:
        """Returns the limb segment that carries a patch; None if the patch has no limb coordinates."""
        part = self.part(patch.part)
        if part.kind != "arm" or part.side is None or not patch.segment:
            return None
        return part.segment(patch.segment)

    def binding(self, middleware: str) -> Binding:
        """Returns the binding to a middleware: the binding in the file, or else the default binding.

        Raises UnknownNameError if there is no binding. Some middlewares have no default binding, because they
        carry only certain robots.
        """
        for binding in self.all_bindings:
            if binding.middleware == middleware:
                return binding
        valid = [binding.middleware for binding in self.all_bindings]
        raise UnknownNameError(f"binding of {self.name}", middleware, valid)

    def servos_of(self, robot_part: str) -> tuple[Servo, ...]:
        """Returns the servos of one of the robot's own parts, sorted by id. Raises UnknownNameError if there
        is no such part."""
        found = tuple(servo for servo in self.servos if servo.robot_part == robot_part)
        if not found:
            names = dict.fromkeys(servo.robot_part for servo in self.servos)
            raise UnknownNameError("robot part", robot_part, names)
        return found
