"""Renders a MuJoCo scene by ray casting on the processor, without a GL library or a screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from tci.lab.pictures.camera import Camera, pixel_centres
from tci.lab.pictures.cast import Caster, Hits, nearer
from tci.lab.pictures.shade import darken, light, outlines, smooth_normals
from tci.messages.frames import Array
from tci.support.engine import mujoco

_SKY = np.array([[1.0, 1.0, 1.0], [0.93, 0.945, 0.96]])
"""Background colours at the top and at the bottom of a picture."""
_SUBPIXELS = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]])
"""Offsets [pixels] of the four additional rays with which a pixel on an outline is smoothed. The offsets form
a rotated grid, which gives good results for steep and flat lines."""


class Painter(Protocol):
    """A function that colours the surfaces of a scene, pixel by pixel."""

    def __call__(self, hits: Hits, footprint: Array) -> Array:
        """Returns red, green, blue and alpha (n, 4), 0 to 1, of n points that rays hit.

        `footprint` (n,) is the size [m] of a pixel at each point. The painter should blur edges over this
        size.
        """
        ...


def render(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: Camera,
    *,
    paint: Sequence[Painter] = (),
    colours: Array | None = None,
) -> NDArray[np.uint8]:
    """Returns a picture (height, width, 3) of the scene with the poses in `data`. Call `mj_forward` before,
    so that `data` is up to date.

    The painters `paint` colour the opaque surfaces in this order, before lighting. `colours` (ngeom, 4), 0 to
    1, are the colours of the geoms, by default those of `model_colours`. A geom with an alpha of 0 is not
    drawn. A geom with an alpha between 0 and 1 is transparent. Only the nearest transparent surface is drawn.
    """
    if colours is None:
        colours = model_colours(model)
    caster = Caster(model, data, colours)
    hits = caster.cast(camera, pixel_centres(camera))
    line, border = outlines(camera, hits)
    picture = darken(_shaded(camera, hits, colours, paint), line)
    picture = _resolve(caster, camera, hits, picture, border)
    if np.any((colours[:, 3] > 0.0) & (colours[:, 3] < 1.0)):
        picture = _glazed(caster, camera, hits, picture, colours)
    return np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def background(height: int) -> Array:
    """Returns the background colour (height, 3), 0 to 1, of each row of a picture."""
    return np.linspace(_SKY[0], _SKY[1], height)


def model_colours(model: mujoco.MjModel) -> Array:
    """Returns the colours (ngeom, 4), 0 to 1, of the model's geoms.

    A geom with a material has the material's colour. Geoms in group 3 and above have an alpha of 0, because
    by convention such geoms are for collisions only.
    """
    colours = np.array(model.geom_rgba, dtype=float)
    material = model.geom_matid >= 0
    colours[material] = model.mat_rgba[model.geom_matid[material]]
    colours[model.geom_group >= 3, 3] = 0.0
    return colours


def _shaded(camera: Camera, hits: Hits, colours: Array, paint: Sequence[Painter]) -> Array:
    """Returns the colours (h, w, 3) of the whole picture, before outlines are drawn."""
    shape = camera.height, camera.width
    result = np.repeat(background(camera.height), camera.width, axis=0)
    normals = smooth_normals(hits.surface.reshape(shape), hits.normals.reshape(*shape, 3)).reshape(-1, 3)
    hit = np.flatnonzero(hits.geom >= 0)
    seen = Hits(
        geom=hits.geom[hit],
        surface=hits.surface[hit],
        distance=hits.distance[hit],
        points=hits.points[hit],
        normals=normals[hit],
    )
    surface = colours[seen.geom, :3]
    footprint = seen.distance / camera.focal
    for painter in paint:
        painted = painter(seen, footprint)
        surface += painted[:, 3:] * (painted[:, :3] - surface)
    result[hit] = surface * light(camera, seen.normals)[:, None]
    return result.reshape(*shape, 3)


def _glazed(caster: Caster, camera: Camera, behind: Hits, picture: Array, colours: Array) -> Array:
    """Returns the picture (h, w, 3) with the nearest transparent surface blended over the opaque surfaces."""
    shape = camera.height, camera.width
    hits = nearer(behind, caster.cast(camera, pixel_centres(camera), opaque=False, glass=True))
    front = (hits.geom != behind.geom).reshape(shape)
    alpha = np.where(front, colours[hits.geom, 3].reshape(shape), 0.0)[..., None]
    line, border = outlines(camera, hits)
    over = darken(picture + alpha * (_shaded(camera, hits, colours, ()) - picture), line & front)
    return _resolve(caster, camera, hits, over, border & binary_dilation(front, np.ones((3, 3))), glass=True)


def _resolve(
    caster: Caster,
    camera: Camera,
    hits: Hits,
    picture: Array,
    border: NDArray[np.bool_],
    *,
    glass: bool = False,
) -> Array:
    """Returns the picture (h, w, 3) with anti-aliased outlines.

    Each pixel in `border` (h, w) gets the mean colour of a few additional rays. If `glass` is True, these
    rays also hit transparent surfaces.
    """
    rows, columns = np.nonzero(border)
    if not len(rows):
        return picture
    shape = camera.height, camera.width
    surface = hits.surface.reshape(shape)
    distance = np.minimum(hits.distance.reshape(shape), mujoco.mjMAXVAL)
    total = np.zeros((len(rows), 3))
    centres = np.stack([columns, rows], axis=1) + 0.5
    for offset in _SUBPIXELS:
        extra = caster.cast(camera, centres + offset, glass=glass)
        best = np.full(len(rows), np.inf)
        colour = picture[rows, columns].copy()
        for dy in (0, -1, 1):
            for dx in (0, -1, 1):
                y, x = np.clip(rows + dy, 0, shape[0] - 1), np.clip(columns + dx, 0, shape[1] - 1)
                away = np.abs(distance[y, x] - np.minimum(extra.distance, mujoco.mjMAXVAL))
                # The middle pixel may be part of the outline. At equal distances the middle pixel is
                # preferred.
                away += 0.5 * (dx != 0 or dy != 0) * distance[y, x] / camera.focal
                away[surface[y, x] != extra.surface] = np.inf
                better = away < best
                best[better] = away[better]
                colour[better] = picture[y, x][better]
        total += colour
    result = picture.copy()
    result[rows, columns] = total / len(_SUBPIXELS)
    return result
