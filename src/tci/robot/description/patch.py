"""Skin patches, and the surfaces on which their taxels are."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tci.messages.frames import Array, read_only, rotation_rpy, transform
from tci.robot.description.base import Description, Vector
from tci.robot.description.sensor import Sensor


class TruncatedCone(Description):
    """Taxels on a truncated cone, numbered ring by ring (eqs 3-4, Fig. 4)."""

    kind: Literal["truncated_cone"] = "truncated_cone"
    origin: Vector = (0.0, 0.0, 0.0)
    """Centre (3,) [m] of the cone's proximal end, in the frame of the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] of the cone's frame in the link's frame. -z points along the axis to the distal
    end, and x points to theta = 0."""
    length: float
    """Length [m] of the cone along its axis."""
    r1: float
    """Radius [m] of the cone at its proximal end."""
    r2: float
    """Radius [m] of the cone at its distal end."""
    rings: int
    """Number of rings of taxels, evenly spaced along the axis."""
    per_ring: int
    """Number of taxels in each ring. Every second ring is turned by half the angle between two taxels."""


class Grid(Description):
    """A flat pad with equal taxels in rows and columns. In the frame of the pad, z points outward, rows are
    counted along x, columns along y, and the origin is the middle of the surface that is touched."""

    kind: Literal["grid"] = "grid"
    rows: int
    columns: int
    length: float
    """Size [m] of the pad along x: each row takes length / rows."""
    width: float
    """Size [m] of the pad along y."""
    thickness: float = 0.0
    """Depth [m] of the pad below its surface. Collisions count it as part of the link; 0 if the model's own
    shapes contain it."""
    order: Literal["row-major", "column-major"] = "row-major"
    """Order of the taxels in a frame: one row after the other, or one column after the other."""
    mirrored: bool = False
    """True if columns are counted against y."""
    origin: Vector = (0.0, 0.0, 0.0)
    """Middle (3,) [m] of the surface, in the frame of the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the pad's frame, in the frame of the patch's link."""

    @cached_property
    def T_LP(self) -> Array:
        """Pose (4, 4) of the pad's frame P in the frame of the patch's link L."""
        return read_only(transform(rotation_rpy(*self.rpy), np.array(self.origin)))


class TriangularModules(Description):
    """Triangular modules of ten taxels and two thermal pads. A frame of the kinematic model defines the pose
    of each module."""

    kind: Literal["triangular_modules"] = "triangular_modules"
    frames: tuple[str, ...]
    """Name of each module's frame in the kinematic model."""
    ports: tuple[int, ...]
    """Position of each module in the raw frame, counted in modules: the channels of the module are 12 * port
    ... 12 * port + 11."""
    turns: tuple[float, ...] = ()
    """Angle [rad] by which each module is rotated about the z axis of its frame. This axis points outward. If
    `turns` is empty, all angles are zero."""


class Table(Description):
    """Taxels with positions from a file next to the description."""

    kind: Literal["table"] = "table"
    file: str
    """Path of the file. After loading, the path is absolute."""
    format: Literal["rows", "icub", "csv", "urdf"] = "rows"
    """Format of the file: `rows` contains only rows x y z nx ny nz [m], `icub` is a skin calibration file as
    used for iCub, `csv` is a table with a header, and `urdf` is a URDF with tactile sensors."""
    sensor: str | None = None
    """Name of the tactile sensor in a URDF. The name is not needed if the URDF has only one tactile
    sensor."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the file's frame, in the frame of the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the file's frame, in the frame of the patch's link."""


SOLE = "foot"
"""Name of the leg segment with skin that touches the ground."""


class Patch(Description):
    """A piece of skin on one link."""

    name: str
    part: str
    """Generic part to which the patch belongs."""
    segment: str = ""
    """Segment of the generic part; empty for skin without a segment (head, hand, torso)."""
    link: str
    """Link of the kinematic model that carries the patch."""
    rate: float
    """Frame rate [Hz]."""
    channels: int
    """Number of values in a raw frame."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Shift [m] of the whole skin in the frame of its link. The shift is added to the positions of the
    taxels, to correct them (`tci skin mount` measures the shift)."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] by which the skin is rotated about the origin of its link, before the shift by
    `xyz`."""
    sensor: Sensor
    surface: Annotated[TruncatedCone | Grid | TriangularModules | Table, Field(discriminator="kind")]
    rigid: bool = False
    """True if the taxels are under one rigid plate, such as the load cells of a foot. All pressed taxels of
    the patch then form one contact."""
    assumed: bool = False
    """True if nobody has seen this skin on the robot: it is proposed, or worn only in simulation."""
    neighbours: float | None = None
    """Largest distance [m] between neighbouring taxels. Neighbours that are pressed form one contact. If
    None, the value is computed from the distances between taxels; `tci skin fit` prints these distances."""

    @property
    def through_joints(self) -> bool:
        """True if the patch has no taxels and sends no frames: touches on the patch are detected from the
        torques of joints."""
        return self.sensor.joints

    @cached_property
    def mount(self) -> Array:
        """Transform (4, 4) by `xyz` and `rpy`, from the described places of taxels to their places in the
        frame of the link."""
        return read_only(transform(rotation_rpy(*self.rpy), np.array(self.xyz)))
