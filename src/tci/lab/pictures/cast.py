"""Casts rays into a MuJoCo scene on the processor, without a screen or a graphics library."""

from __future__ import annotations

import copy
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.lab.pictures.camera import Camera, rays
from tci.messages.frames import Array
from tci.support.engine import mujoco

_CHUNK = 8192
"""Number of rays that a thread casts at once. The number is small, so that all threads have work until the
end."""
_OPAQUE, _GLASS, _HIDDEN = 0, 1, 5
"""Geom groups of opaque, transparent and hidden geoms, in the copy of the model into which rays are cast."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """The nearest hits of n rays."""

    geom: NDArray[np.int32]
    """Index (n,) of the geom that each ray hits, or -1 if the ray hits nothing."""
    surface: NDArray[np.int32]
    """Number (n,) of the hit surface, equal for all opaque geoms of one body and colour; -1 if the ray hits
    nothing."""
    distance: Array
    """Distance (n,) [m] from the camera, or infinity if the ray hits nothing."""
    points: Array
    """Hit points (n, 3) [m] in the world frame, or NaN if the ray hits nothing."""
    normals: Array
    """Unit normals (n, 3) at the hit points, pointing to the camera's side of the surface, or 0 if the ray
    hits nothing."""


def nearer(first: Hits, second: Hits) -> Hits:
    """Merges two sets of hits (n,) of the same rays. For each ray the nearer hit is used."""
    closer = second.distance < first.distance
    return Hits(
        geom=np.where(closer, second.geom, first.geom),
        surface=np.where(closer, second.surface, first.surface),
        distance=np.where(closer, second.distance, first.distance),
        points=np.where(closer[:, None], second.points, first.points),
        normals=np.where(closer[:, None], second.normals, first.normals),
    )


class Caster:
    """Casts the rays of a camera at the geoms of a scene. Each geom is opaque, transparent ("glass") or
    hidden.

    All opaque geoms of one body and one colour form one surface. All glass of one colour also forms one
    surface.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, colours: Array) -> None:
        """Creates a caster for a scene. The poses are those in `data` at the time of the first `cast`.

        `colours` (ngeom, 4) are the colours of the geoms. A geom with an alpha of 1 is opaque, one with 0 is
        hidden, and one with a value between is transparent.
        """
        # MuJoCo selects geoms by group and by the alpha in the model, so both are set in a copy of the model.
        self._model = copy.copy(model)
        alpha = colours[:, 3]
        self._model.geom_group[:] = np.select([alpha >= 1.0, alpha > 0.0], [_OPAQUE, _GLASS], _HIDDEN)
        self._model.geom_matid[:] = -1
        self._model.geom_rgba[:, 3] = 1.0
        self._data = data
        # MuJoCo uses the working memory in `data`, so each thread needs a separate copy.
        self._copies: list[mujoco.MjData] = []
        looks = np.column_stack([np.where(alpha >= 1.0, model.geom_bodyid, -1), colours])
        surfaces = np.unique(looks, axis=0, return_inverse=True)[1].ravel()
        # the last element is for the geom index -1, which means no hit
        self._surfaces = np.append(surfaces, -1).astype(np.int32)

    def cast(self, camera: Camera, pixels: Array, *, opaque: bool = True, glass: bool = False) -> Hits:
        """Returns the nearest hit of the ray through each of the `pixels` (n, 2). The rays hit `opaque`
        geoms, `glass`, or both, as these arguments say."""
        groups = np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
        groups[_OPAQUE], groups[_GLASS] = opaque, glass
        origin = np.ascontiguousarray(camera.T_WC[:3, 3])
        directions = rays(camera, pixels)
        geom = np.full(len(pixels), -1, dtype=np.int32)
        distance = np.empty(len(pixels))
        normals = np.empty((len(pixels), 3))

        def cast_chunk(start: int) -> None:
            part = slice(start, start + _CHUNK)
            ids, lengths = geom[part], distance[part]  # views, so that MuJoCo writes into the whole arrays
            try:
                data = self._copies.pop()
            except IndexError:
                data = copy.copy(self._data)
            mujoco.mj_multiRay(
                self._model,
                data,
                origin,
                directions[part].ravel(),
                groups,
                True,
                -1,
                ids,
                lengths,
                normals[part].reshape(-1),
                len(ids),
                mujoco.mjMAXVAL,
            )
            self._copies.append(data)

        # The call releases Python's global lock, so threads run in parallel.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(cast_chunk, range(0, len(pixels), _CHUNK)))
        missed = geom < 0
        distance[missed] = np.inf
        normals[missed] = 0.0
        away = np.einsum("ij,ij->i", normals, directions) > 0.0
        normals[away] *= -1.0
        points = origin + np.where(missed, np.nan, distance)[:, None] * directions
        return Hits(
            geom=geom, surface=self._surfaces[geom], distance=distance, points=points, normals=normals
        )
