"""From a click to a place on the skin."""

from __future__ import annotations

import numpy as np

from tci.body.places import Place
from tci.frames import Array, apply, invert, read_only
from tci.viewer.figure import Figure

NEAR = 0.015
"""How far [m] beside the skin a click may fall. Ours."""
BEHIND = 0.03
"""How far [m] below what is drawn the skin may lie: covers stand over it. Ours."""


def pick(figure: Figure, origin: Array, direction: Array) -> tuple[Place, float] | None:
    """The place of a figure's skin that a ray of the scene meets, and its distance [m].

    `origin` (3,) [m], `direction` (3,), a unit vector. None where it meets no skin, or something else
    first. One that goes by within `NEAR` finds the nearest taxel that it sees.
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
        # Of taxels in the ray's way the one in front.
        taxel = near[np.argmin(depth[near] + 2.0 * aside[near])]
        if best is None or depth[taxel] < best[0]:
            # The tangent plane at that taxel is met where the ray points to.
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
