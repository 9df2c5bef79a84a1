"""Computes positions and normals of the skin in the current posture, in the world or torso frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, UnknownNameError
from tci.messages.frames import Array, apply, invert
from tci.robot.description import Model
from tci.simulation.physics import Physics
from tci.skin.surfaces import Surface


class PosedSkin:
    """Poses of a world's patches of skin, in the world frame or the torso frame."""

    def __init__(self, physics: Physics, model: Model, surfaces: Mapping[str, Surface]) -> None:
        self.surfaces = surfaces
        self._physics = physics
        self._torso = physics.model.body(model.torso_link).id
        self._T_LT = model.T_LT
        self._bodies = {name: physics.model.body(surface.link).id for name, surface in surfaces.items()}

    def torso(self) -> Array:
        """Returns `T_WT` (4, 4), the current pose of the torso frame in the world frame."""
        return self._physics.pose(self._torso) @ self._T_LT

    def link(self, patch: str) -> Array:
        """Returns `T_WL` (4, 4), the current pose of a patch's link in the world frame.

        Raises UnknownNameError for an unknown patch.
        """
        self.surface(patch)
        return self._physics.pose(self._bodies[patch])

    def surface(self, patch: str) -> Surface:
        """Returns the surface of a patch. Raises UnknownNameError for an unknown patch."""
        if patch not in self.surfaces:
            raise UnknownNameError("skin patch in this world", patch, self.surfaces)
        return self.surfaces[patch]

    def point(
        self, patch: str, place: int | ArrayLike, normal: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Returns the current position (3,) [m] and outward unit normal (3,) of a point on the skin.

        Position and normal are in the world frame. `place` is a taxel, or a point (3,) [m] in the frame of
        the patch's link. An outward `normal` (3,) in the link's frame replaces the surface normal, if given.
        Raises UnknownNameError for an unknown patch, and CommandError for an invalid point or normal.
        """
        surface = self.surface(patch)
        if isinstance(place, int | np.integer):
            if not 0 <= place < len(surface.positions):
                raise CommandError(f"taxel {place} of {patch}; valid: 0 to {len(surface.positions) - 1}")
            point, own = surface.positions[place], surface.normals[place]
        elif isinstance(place, str):
            last = len(surface.positions) - 1
            raise CommandError(f"place {place!r} on {patch}; valid: taxel 0 to {last}, or a point (3,) [m]")
        else:
            point = _vector("place", place)
            own = surface.project(point[None])[1][0] if normal is None else None
        outward = own if normal is None else unit("normal", normal)
        T_WL = self.link(patch)
        return apply(T_WL, point), T_WL[:3, :3] @ outward

    def from_torso(self, point: ArrayLike, normal: ArrayLike) -> tuple[Array, Array]:
        """Transforms a point (3,) [m] and a direction (3,) from the torso frame to the world frame."""
        T_WT = self.torso()
        return apply(T_WT, _vector("point", point)), T_WT[:3, :3] @ unit("normal", normal)

    def to_torso(self, point: ArrayLike, normal: ArrayLike) -> tuple[Array, Array]:
        """Transforms a point (3,) [m] and a direction (3,) from the world frame to the torso frame."""
        T_TW = invert(self.torso())
        return apply(T_TW, np.asarray(point)), T_TW[:3, :3] @ np.asarray(normal)


def unit(name: str, values: ArrayLike) -> Array:
    """Returns the unit vector (3,) along `values`.

    Raises CommandError if `values` have no direction, for example zeros.
    """
    vector = _vector(name, values)
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise CommandError(f"{name} {vector.tolist()} has no direction; valid: a length above 0")
    return vector / length


def _vector(name: str, values: ArrayLike) -> Array:
    vector = np.asarray(values, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise CommandError(f"{name} {vector.tolist()}; valid: three finite numbers")
    return vector
