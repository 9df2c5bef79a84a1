"""Shades the points that rays hit: smooth normals, two lights, and dark outlines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.lab.pictures.camera import Camera
from tci.lab.pictures.cast import Hits
from tci.messages.frames import Array

# The values below are chosen by eye.
_CREASE = np.cos(np.deg2rad(40.0))
"""Cosine of the largest angle between two faces that are shaded as one smooth surface."""
_KEY = np.array([-0.55, -0.75, -0.55])
"""Direction towards the key light, which is the main light, in the camera frame: x to the right, y down, z
forward. The light is above, to the left of and behind the camera."""
_AMBIENT, _KEY_STRENGTH, _HEAD_STRENGTH = 0.50, 0.45, 0.32
_JUMP = 3.0
"""Least step in depth at which an outline is drawn, as a multiple of a pixel's size on the surface."""
_OUTLINE = 0.55
"""Fraction of black in the colour of an outline."""

Offset = tuple[slice, slice]


def _neighbours(step: int) -> list[tuple[Offset, Offset]]:
    """Returns pairs of index ranges of an image. The second range of a pair selects the region that is
    shifted from the region of the first by `step` pixels: sideways, down, or diagonally."""
    here, there, everywhere = slice(None, -step), slice(step, None), slice(None)
    return [
        ((everywhere, here), (everywhere, there)),
        ((here, everywhere), (there, everywhere)),
        ((here, here), (there, there)),
        ((here, there), (there, here)),
    ]


def smooth_normals(surface: NDArray[np.int32], normals: Array, *, passes: int = 2) -> Array:
    """Returns normals (h, w, 3) without visible facets of a mesh. Normals are averaged only between pixels
    with equal values in `surface` (h, w), and not across creases.

    The filter is the edge-avoiding a-trous wavelet of Dammertz et al. 2010: each pass averages over twice the
    distance of the previous pass.
    """
    result = normals.astype(np.float32)
    for level in range(passes):
        total = result.copy()
        for a, b in _neighbours(2**level):
            same = (surface[a] == surface[b]) & (np.einsum("hwi,hwi->hw", result[a], result[b]) > _CREASE)
            total[a] += same[..., None] * result[b]
            total[b] += same[..., None] * result[a]
        length = np.linalg.norm(total, axis=2, keepdims=True)
        result = np.divide(total, length, out=np.zeros_like(total), where=length > 0.0)
    return result.astype(np.float64)


def light(camera: Camera, normals: Array) -> Array:
    """Returns the brightness (n,) of surfaces by Lambert's law. The unit normals (n, 3) are in the world
    frame."""
    normals_C = normals @ camera.T_WC[:3, :3]
    key = np.clip(normals_C @ (_KEY / np.linalg.norm(_KEY)), 0.0, None)
    head = np.clip(-normals_C[:, 2], 0.0, None)
    sky = 0.5 - 0.5 * normals_C[:, 1]  # soft light from above
    brightness: Array = _AMBIENT * (0.6 + 0.4 * sky) + _KEY_STRENGTH * key + _HEAD_STRENGTH * head
    return brightness


def outlines(camera: Camera, hits: Hits) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns two masks (h, w) of a picture: pixels on which an outline is drawn, and pixels on both sides of
    an edge.

    An edge lies where neighbouring pixels show different surfaces, or where the depth has a step. The outline
    is drawn on the pixel that is nearer to the camera.
    """
    shape = camera.height, camera.width
    surface, distance = hits.surface.reshape(shape), hits.distance.reshape(shape)
    points, normals = hits.points.reshape(*shape, 3), hits.normals.reshape(*shape, 3)
    line = np.zeros(shape, dtype=bool)
    border = np.zeros(shape, dtype=bool)
    for a, b in _neighbours(1):
        gap = points[b] - points[a]
        step = np.minimum(
            np.abs(np.einsum("hwi,hwi->hw", gap, normals[a])),
            np.abs(np.einsum("hwi,hwi->hw", gap, normals[b])),
        )
        apart = (surface[a] != surface[b]) | (step > _JUMP * distance[a] / camera.focal)
        line[a] |= apart & (distance[a] <= distance[b])
        line[b] |= apart & (distance[b] < distance[a])
        border[a] |= apart
        border[b] |= apart
    return line, border


def darken(colours: Array, line: NDArray[np.bool_]) -> Array:
    """Returns the colours (h, w, 3) with the outlines (h, w) drawn in a darker colour."""
    return colours * np.where(line, 1.0 - _OUTLINE, 1.0)[..., None]
