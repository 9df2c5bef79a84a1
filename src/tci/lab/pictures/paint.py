"""Colours the skin in a picture: taxels are dots coloured by pressure, receptive fields are tinted areas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from tci.capabilities.fields import ReceptiveField
from tci.lab.pictures.cast import Hits
from tci.messages.frames import Array, apply
from tci.robot.generic_arm import Side, limb_coordinates
from tci.robot.limb import generic_limb_distance

# The colours and sizes below are chosen by eye.
PRESSURE_COLOURS = ((0.50, 0.58, 0.67), (0.87, 0.34, 0.29), (0.97, 0.58, 0.16), (1.00, 0.94, 0.50))
"""Colours for pressures from 0 to full scale, evenly spaced. A higher pressure has a warmer and lighter
colour, since the skin itself is dark."""
FIELD_COLOURS = (
    (0.25, 0.60, 0.95), (0.45, 0.80, 0.30), (0.10, 0.80, 0.76), (0.74, 0.55, 0.98), (0.85, 0.88, 0.92)
)  # fmt: skip
"""Colours of the receptive fields. If there are more fields than colours, the colours repeat. They are cool,
since the colours of pressure are warm."""
SKIN_COLOUR = (0.30, 0.32, 0.36)
"""Colour of links that carry skin."""
FULL_SCALE = 40e3
"""Pressure [Pa] from which a dot has the colour of the highest pressures, light yellow."""
_SWELL = 1.0
"""Relative increase of a dot's radius from pressure 0 to FULL_SCALE. The increase makes small contacts
visible."""
_LEVEL = 0.010
"""Largest distance [m] above or below a taxel at which the taxel's dot colours a surface."""


def pressure_colours(pressure: ArrayLike, full_scale: float) -> Array:
    """Returns the colours (n, 3), 0 to 1, of `pressure` (n,) [Pa]. Pressures above `full_scale` [Pa] have the
    last colour of PRESSURE_COLOURS."""
    share = np.clip(np.asarray(pressure, dtype=float) / full_scale, 0.0, 1.0)
    anchors = np.array(PRESSURE_COLOURS)
    places = np.linspace(0.0, 1.0, len(anchors))
    return np.stack([np.interp(share, places, anchors[:, channel]) for channel in range(3)], axis=-1)


class TaxelPaint:
    """Paints a dot on the surface at every taxel. The dot's colour shows the taxel's pressure."""

    def __init__(
        self, positions: Array, normals: Array, pressure: Array, *, full_scale: float, radius: float = 0.0016
    ) -> None:
        """Creates a painter of taxels at `positions` (n, 3) [m] with outward `normals` (n, 3), both in the
        world frame.

        `pressure` (n,) [Pa] is the pressure on the taxels, and `radius` [m] the radius of a dot at no
        pressure. A dot is drawn on the surface at the taxel. So the dot is not visible if another object
        hides this surface.
        """
        self._tree = KDTree(positions)
        self._normals = normals
        self._radius = radius * (1.0 + _SWELL * np.clip(pressure / full_scale, 0.0, 1.0))
        self._colours = pressure_colours(pressure, full_scale)

    def __call__(self, hits: Hits, footprint: Array) -> Array:
        result = np.zeros((len(hits.points), 4))
        reach = np.hypot(1.2 * self._radius.max(), _LEVEL)
        distance, nearest = self._tree.query(hits.points, distance_upper_bound=reach)
        close = np.flatnonzero(np.isfinite(distance))
        taxel = nearest[close]
        offset = hits.points[close] - self._tree.data[taxel]
        height = np.einsum("ij,ij->i", offset, self._normals[taxel])
        across = np.sqrt(np.clip(np.einsum("ij,ij->i", offset, offset) - height**2, 0.0, None))
        outside = np.einsum("ij,ij->i", hits.normals[close], self._normals[taxel]) > 0.0
        inside = 0.5 + (self._radius[taxel] - across) / footprint[close]
        result[close, :3] = self._colours[taxel]
        result[close, 3] = np.where(outside & (np.abs(height) <= _LEVEL), np.clip(inside, 0.0, 1.0), 0.0)
        return result


@dataclass(frozen=True, slots=True)
class FieldLook:
    """Appearance of a receptive field, which is a disc on the generic limb (eq. 6)."""

    segment: str
    """Segment of the arm: `upper_arm` or `forearm`."""
    u: float
    """Position of the centre along the segment: 0 is the proximal end, 1 the distal end."""
    theta: float
    """Angle [rad] of the centre around the segment."""
    radius: float
    """Radius [limb lengths] on the generic limb."""
    colour: tuple[float, float, float]
    """Red, green and blue, 0 to 1."""
    strength: float = 0.45
    """Strength of the tint on the skin, 0 to 1."""


def field_looks(fields: Sequence[ReceptiveField]) -> list[FieldLook]:
    """Returns the appearance of receptive fields in pictures."""
    return [
        FieldLook(
            field.segment, field.u, field.theta, field.radius, FIELD_COLOURS[index % len(FIELD_COLOURS)]
        )
        for index, field in enumerate(fields)
    ]


class FieldPaint:
    """Tints the receptive fields on one segment of a limb, and draws the edges of the fields."""

    def __init__(
        self,
        positions: Array,
        normals: Array,
        T_SW: Array,
        length: float,
        side: Side,
        fields: Sequence[FieldLook],
        *,
        reach: float = 0.009,
    ) -> None:
        """Creates a painter of the receptive fields `fields` on skin with taxels at `positions` (n, 3) [m].

        `normals` (n, 3) are the outward normals of the taxels. Positions and normals are in the world frame.
        `T_SW` (4, 4) is the pose of the world in the segment's frame, and `length` [m] the length of the
        segment. Only the outer side of surfaces within the distance `reach` [m] of a taxel is painted.
        """
        self._tree = KDTree(positions)
        self._normals = normals
        self._T_SW = T_SW
        self._length = length
        self._side: Side = side
        self._fields = tuple(fields)
        self._reach = reach

    def __call__(self, hits: Hits, footprint: Array) -> Array:
        result = np.zeros((len(hits.points), 4))
        gap, taxel = self._tree.query(hits.points, distance_upper_bound=self._reach)
        near = np.flatnonzero(np.isfinite(gap))
        near = near[np.einsum("ij,ij->i", hits.normals[near], self._normals[taxel[near]]) > 0.0]
        u, theta = limb_coordinates(apply(self._T_SW, hits.points[near]), self._length, self._side)
        pixel = footprint[near] / self._length
        for field in self._fields:
            depth = (field.radius - generic_limb_distance(u, theta, field.u, field.theta)) / pixel
            tint = field.strength * np.clip(0.5 + depth, 0.0, 1.0)
            rim = np.clip(1.5 - np.abs(depth - 1.0), 0.0, 1.0)
            alpha = np.maximum(tint, 0.9 * rim)
            over = alpha > result[near, 3]
            result[near[over], :3] = field.colour
            result[near[over], 3] = alpha[over]
        return result
