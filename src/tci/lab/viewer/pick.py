"""Converts a click to a point on the skin."""

from __future__ import annotations

import numpy as np
import viser

from tci.body.places import Place
from tci.lab.viewer.figure import Figure
from tci.messages.frames import Array, apply, invert, read_only
from tci.support.engine import mujoco

NEAR = 0.015
"""Largest distance [m] between a click and the taxel that the click selects. Assumed: about two taxels of
iCub's skin."""
BEHIND = 0.03
"""Largest depth [m] below the visible surface at which a click selects skin. Assumed: covers over the skin
are thinner."""


def ray(camera: viser.CameraHandle, x: float, y: float) -> tuple[Array, Array]:
    """Origin (3,) [m] and direction (3,) of the ray through a point of the picture, from 0 to 1 to the right
    and down."""
    up = np.tan(camera.fov / 2.0)
    seen = np.array([(2.0 * x - 1.0) * up * camera.aspect, (2.0 * y - 1.0) * up, 1.0])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, camera.wxyz)
    direction = rotation.reshape(3, 3) @ seen
    return np.array(camera.position), direction / np.linalg.norm(direction)


def pick(figure: Figure, origin: Array, direction: Array) -> tuple[Place, float] | None:
    """Returns the point at which a ray hits the skin of `figure`, a robot in the scene. Also returns the
    distance [m] of this point along the ray.

    `origin` (3,) [m] and the unit vector `direction` (3,) define the ray. The ray hits the skin if it passes
    a visible taxel at a distance of less than `NEAR` [m]. Returns None if the ray hits no skin, or hits
    another surface first.
    """
    best: tuple[float, Place] | None = None
    for name, surface in figure.skin.surfaces.items():
        T_LS = invert(figure.pose(surface.link))
        start, along = apply(T_LS, origin), T_LS[:3, :3] @ direction
        offset = surface.positions - start
        depth = offset @ along
        aside = np.linalg.norm(offset - depth[:, None] * along, axis=1)
        seen = (surface.normals @ along < 0.0) & (depth > 0.0)
        aside[~seen] = np.inf
        near = np.flatnonzero(aside < NEAR)
        if not near.size:
            continue
        # Of all taxels near the ray, the nearest to the camera is selected.
        taxel = near[np.argmin(depth[near] + 2.0 * aside[near])]
        if best is None or depth[taxel] < best[0]:
            # The selected place is the point at which the ray meets the tangent plane of the taxel.
            normal = surface.normals[taxel]
            reach = (
                float(offset[taxel] @ normal / (along @ normal))
                if abs(along @ normal) > 0.3
                else depth[taxel]
            )
            points, normals = surface.project((start + reach * along)[None])
            best = float(depth[taxel]), Place(name, read_only(points[0]), read_only(normals[0]))
    if best is None or figure.distance(origin, direction) < best[0] - BEHIND:
        return None
    return best[1], best[0]
