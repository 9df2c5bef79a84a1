"""Pieces of skin, and the surfaces that their taxels lie on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tci.robot.description.base import Description, Vector
from tci.robot.description.sensor import Sensor


class TruncatedCone(Description):
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


class TriangularModules(Description):
    """Triangular modules of ten taxels (and two thermal pads), each at a frame of the model."""

    kind: Literal["triangular_modules"] = "triangular_modules"
    frames: tuple[str, ...]
    """Frame of each module in the kinematic model."""
    ports: tuple[int, ...]
    """Place of each module in the raw frame: its channels are 12 * port ... 12 * port + 11."""
    turns: tuple[float, ...] = ()
    """Angle [rad] of each module about its frame's z axis, which points outward; empty: all zero."""


class Table(Description):
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


class Patch(Description):
    """A piece of skin on one link."""

    name: str
    part: str
    """Generic part it belongs to."""
    segment: str = ""
    """Segment of that part; empty for skin that is on none of its segments (head, hand, torso)."""
    link: str
    """Driver of the kinematic model that carries it."""
    rate: float
    """Frames per second [Hz]."""
    channels: int
    """Values in a raw frame."""
    sensor: Sensor
    surface: Annotated[TruncatedCone | TriangularModules | Table, Field(discriminator="kind")]
    rigid: bool = False
    """Whether its taxels carry one rigid plate, as the load cells under a foot: then all that are pressed
    are one contact."""
