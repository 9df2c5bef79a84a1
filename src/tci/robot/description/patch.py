"""Pieces of skin, and the surfaces on which their taxels lie."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tci.robot.description.base import Description, Vector
from tci.robot.description.sensor import Sensor


class TruncatedCone(Description):
    """Taxels on a truncated cone, ring by ring (eqs 3-4, Fig. 4)."""

    kind: Literal["truncated_cone"] = "truncated_cone"
    origin: Vector = (0.0, 0.0, 0.0)
    """Centre (3,) [m] of the cone's proximal end, in the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] of the cone's frame in the link: -z points along the axis to the distal end, x
    to theta = 0."""
    length: float
    """Length [m] of the cone along its axis."""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rings: int
    """Number of rings of taxels, evenly spaced along the axis."""
    per_ring: int
    """Number of taxels in each ring; every second ring is turned by half a step."""


class TriangularModules(Description):
    """Triangular modules of ten taxels and two thermal pads, each at a frame of the kinematic model."""

    kind: Literal["triangular_modules"] = "triangular_modules"
    frames: tuple[str, ...]
    """Frame of each module in the kinematic model."""
    ports: tuple[int, ...]
    """Position of each module in the raw frame: its channels are 12 * port ... 12 * port + 11."""
    turns: tuple[float, ...] = ()
    """Angle [rad] of each module about its frame's z axis, which points outward. Empty: all angles are
    zero."""


class Table(Description):
    """Taxels from a file next to the description."""

    kind: Literal["table"] = "table"
    file: str
    """Path of the file; absolute after loading."""
    format: Literal["rows", "icub", "csv", "urdf"] = "rows"
    """Format of the file: `rows` has only rows x y z nx ny nz [m], `icub` is a skin calibration file like
    iCub's, `csv` a table with a header, `urdf` a URDF with tactile sensors."""
    sensor: str | None = None
    """Name of the tactile sensor in a URDF; not needed if there is only one."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Origin [m] of the file's frame in the patch's link."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Orientation [rad] of the file's frame in the patch's link."""


SOLE = "foot"
"""Name of the segment of a leg whose skin touches the ground."""


class Patch(Description):
    """A piece of skin on one link."""

    name: str
    part: str
    """Generic part that the patch belongs to."""
    segment: str = ""
    """Segment of that part; empty for skin without a segment (head, hand, torso)."""
    link: str
    """Link of the kinematic model that carries the patch."""
    rate: float
    """Frame rate [Hz]."""
    channels: int
    """Number of values in a raw frame."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """Shift [m] of the skin in its link, relative to the described places of its taxels (`tci skin
    mount`)."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw [rad] by which the skin is rotated about the link's origin before the shift."""
    sensor: Sensor
    surface: Annotated[TruncatedCone | TriangularModules | Table, Field(discriminator="kind")]
    rigid: bool = False
    """True if its taxels are under one rigid plate, such as the load cells of a foot. All pressed taxels then
    form one contact."""
    neighbours: float | None = None
    """Largest distance [m] of neighbouring taxels; pressed neighbours form one contact. None: computed from
    the distances between taxels (`tci skin fit`)."""

    @property
    def through_joints(self) -> bool:
        """True if it has no taxels and sends no frames: touches on it are felt through joints."""
        return self.sensor.joints
