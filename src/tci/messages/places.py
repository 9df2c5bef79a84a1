"""Places on the skin of any robot."""

from __future__ import annotations

from dataclasses import dataclass


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
