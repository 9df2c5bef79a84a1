"""The flat outline of a pad: from the points of its mesh or box, the frame, size and thickness of the pad."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tci.messages.frames import Array, transform

CELLS = 6
"""The outer surface is the highest point in each of CELLS x CELLS cells of the outline: their mean is its
height, so that a rim or a bent edge counts little."""
FLAT = 0.02
"""Least share of a pad's longest side that it must be wide. Assumed: below it a mesh is a line, not a pad."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A rectangle that touches the outer surface of a pad."""

    T_LP: Array
    """Pose (4, 4) in the frame of the pad's link: origin in the middle of the surface, z outward, x along the
    limb, towards its near end."""
    size: tuple[float, float]
    """Size [m] along x and y."""
    thickness: float

    def turned(self) -> Outline:
        """The same rectangle with x and y exchanged."""
        x, y, z, p = self.T_LP[:3, :4].T
        return Outline(transform(np.column_stack([y, -x, z]), p), self.size[::-1], self.thickness)


def outline(points: Array, inside: Array, joint: Array) -> Outline | None:
    """The outline of a pad, or None if its points lie on a line.

    Args:
        points: Points (n, 3) [m] of the pad's shapes.
        inside: Points (m, 3) [m] of the shapes that carry the pad: they lie behind it.
        joint: Origin (3,) [m] of the link that carries it.
    """
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    lengths, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[1:]
    if len(points) < 4 or lengths[1] < FLAT * lengths[0]:
        return None
    normal = outward(axes[2], centre, inside, float(np.ptp(points @ axes[0])))
    u, v = _sides(points, normal)
    along = centre - joint
    x, y = (u, v) if abs(float(u @ along)) >= abs(float(v @ along)) else (v, u)
    x = x if float(x @ along) <= 0.0 else -x
    y = np.cross(normal, x)
    flat = points @ np.column_stack([x, y])
    low, high = flat.min(axis=0), flat.max(axis=0)
    height = points @ normal
    place = np.minimum(CELLS * (flat - low) / (high - low), CELLS - 1).astype(int) @ [CELLS, 1]
    top = float(np.mean([height[place == one].max() for one in np.unique(place)]))
    middle = 0.5 * (low + high)
    origin = middle[0] * x + middle[1] * y + top * normal
    size = float(high[0] - low[0]), float(high[1] - low[1])
    return Outline(transform(np.column_stack([x, y, normal]), origin), size, float(np.ptp(height)))


def outward(normal: Array, centre: Array, inside: Array, reach: float) -> Array:
    """`normal` or its opposite, whichever points away from the shapes that carry the pad."""
    off = inside - centre
    near = off[np.linalg.norm(off, axis=1) < 1.5 * reach]
    depth = (near if len(near) else off) @ normal
    return -normal if len(depth) and float(np.mean(depth)) > 0.0 else normal


def best_axis(frame: Array, inside: Array) -> Array:
    """The axis of a frame (4, 4), with its sign, that points away from the middle of the carrying shapes; its
    z axis if there are none."""
    if not len(inside):
        return np.array(frame[:3, 2])
    away = frame[:3, 3] - 0.5 * (inside.min(axis=0) + inside.max(axis=0))
    axes = np.concatenate([frame[:3, 2::-1].T, -frame[:3, 2::-1].T])
    return np.array(axes[int(np.argmax(axes @ away))])


def _sides(points: Array, normal: Array) -> tuple[Array, Array]:
    """Unit vectors (3,) along the sides of the smallest rectangle around the points, seen along `normal`."""
    across = np.linalg.svd(normal[None])[2][1:]
    flat = points @ across.T
    try:
        rim = flat[ConvexHull(flat).vertices]
    except QhullError:
        rim = flat
    edges = np.roll(rim, -1, axis=0) - rim
    angles = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (0.5 * np.pi), 6))
    turned = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in angles]
    best = min(turned, key=lambda turn: float(np.prod(np.ptp(rim @ turn.T, axis=0))))
    u, v = best @ across
    return u, v
