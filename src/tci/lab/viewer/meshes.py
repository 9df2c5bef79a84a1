"""The shapes of a robot's links as triangle meshes, small enough for a browser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.lab.pictures.paint import SKIN_COLOUR
from tci.lab.pictures.render import model_colours
from tci.messages.frames import Array
from tci.support.engine import mujoco

CELL, COARSER = 0.003, 1.25
"""Edge [m] of the cubes in which vertices are merged, and the factor by which the edge is enlarged until
there are few enough triangles. Assumed: a balance of detail and transfer time."""
ENOUGH, COARSEST = 4000, 0.006
"""Vertices that lie in one cube are merged, with larger and larger cubes, until a body has at most ENOUGH
triangles of one colour. COARSEST: longest edge [m] of a cube. On a body with skin, the cubes are not
enlarged. Assumed: a balance of detail and transfer time."""

ROUND = 32
"""Number of sides of a round shape. Assumed: with so many sides the shape looks round on a screen."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyMesh:
    """All triangles of one colour on one body."""

    body: int
    """Body of the MuJoCo model."""
    vertices: Array
    """Corners (n, 3) [m] in the body's frame."""
    faces: NDArray[np.intp]
    """Vertex indices (m, 3) of the triangles."""
    colour: tuple[int, int, int]
    """Red, green, blue, 0 to 255."""


def body_meshes(model: mujoco.MjModel, covered: set[int]) -> list[BodyMesh]:
    """Returns the visible meshes of a model. Bodies in `covered` carry skin, and are drawn in the colour of
    skin."""
    colours = model_colours(model)
    found: dict[tuple[int, tuple[int, int, int]], list[tuple[Array, NDArray[np.intp]]]] = {}
    for geom in range(model.ngeom):
        if colours[geom, 3] <= 0.0:
            continue
        shape = _triangles(model, geom)
        if shape is None:
            continue
        vertices, faces = shape
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        vertices = vertices @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        body = int(model.geom_bodyid[geom])
        colour = SKIN_COLOUR if body in covered else colours[geom, :3]
        red, green, blue = (round(255 * float(value)) for value in colour)
        found.setdefault((body, (red, green, blue)), []).append((vertices, faces))
    return [
        BodyMesh(body, *_lighter(*_joined(shapes), coarsest=CELL if body in covered else COARSEST), colour)
        for (body, colour), shapes in found.items()
    ]


def _triangles(model: mujoco.MjModel, geom: int) -> tuple[Array, NDArray[np.intp]] | None:
    """Returns vertices (n, 3) [m] and triangles (m, 3) of a shape of the MuJoCo model, in the shape's own
    frame. `geom` is the index of the shape. Returns None if the shape is not drawn."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        begin, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        return np.array(model.mesh_vert[first : first + count], dtype=float), np.array(
            model.mesh_face[begin : begin + faces], dtype=np.intp
        )
    if kind == kinds.mjGEOM_BOX:
        return _CORNERS * size, _SIDES
    quarter = np.linspace(0.0, np.pi / 2.0, ROUND // 4 + 1)
    dome = np.column_stack([np.sin(quarter), np.cos(quarter)])
    bowl = dome[::-1] * [1.0, -1.0]
    if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        ball, sides = _turned(np.concatenate([dome, bowl[1:]]))
        return ball * (size[0] if kind == kinds.mjGEOM_SPHERE else size), sides
    radius, half = size[0], np.array([0.0, size[1]])
    if kind == kinds.mjGEOM_CAPSULE:
        return _turned(np.concatenate([radius * dome + half, radius * bowl - half]))
    if kind == kinds.mjGEOM_CYLINDER:
        rim = np.array([radius, 0.0])
        return _turned(np.array([half, rim + half, rim - half, -half]))
    return None


_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Corners (8, 3) of a cube with edges of 2."""
_SIDES = np.array([
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
], np.intp)  # fmt: skip
"""Triangles (12, 3) of the cube, as indices of its corners, in anticlockwise order seen from outside."""


def _turned(profile: Array) -> tuple[Array, NDArray[np.intp]]:
    """Returns vertices (n, 3) [m] and triangles (m, 3) of the surface that a profile covers when it turns
    about the z axis. Each row of `profile` (k, 2) contains radius and z [m]. The profile runs from top to
    bottom; both ends are on the z axis."""
    angle = 2.0 * np.pi * np.arange(ROUND) / ROUND
    radius, z = profile[:, :1], profile[:, 1:]
    rings = np.stack([radius * np.cos(angle), radius * np.sin(angle), z + 0.0 * angle], axis=2)
    here = np.arange((len(profile) - 1) * ROUND).reshape(-1, ROUND)
    beside, below = np.roll(here, -1, axis=1), here + ROUND
    upper = np.stack([here, below, below - here + beside], axis=2)[:-1]
    lower = np.stack([here, below - here + beside, beside], axis=2)[1:]  # the ends are points
    return rings.reshape(-1, 3), np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])


def _joined(shapes: list[tuple[Array, NDArray[np.intp]]]) -> tuple[Array, NDArray[np.intp]]:
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in shapes[:-1]])
    faces = [faces + start for start, (_, faces) in zip(starts, shapes, strict=True)]
    return np.concatenate([vertices for vertices, _ in shapes]), np.concatenate(faces)


def _lighter(vertices: Array, faces: NDArray[np.intp], *, coarsest: float) -> tuple[Array, NDArray[np.intp]]:
    """Returns a mesh with fewer triangles: all vertices of one side in one cube are replaced by their mean
    (Rossignac and Borrel 1993). The edge of the cubes is at most `coarsest` [m]. A mesh with few triangles
    (`ENOUGH`) is returned unchanged."""
    fewer, cell = (vertices, faces), CELL
    while len(fewer[1]) > ENOUGH and cell <= coarsest:
        fewer = _merged(vertices, faces, cell)
        cell *= COARSER
    return fewer


def _merged(vertices: Array, faces: NDArray[np.intp], size: float) -> tuple[Array, NDArray[np.intp]]:
    """Merges the vertices in each cube with an edge of `size` [m] whose normals are nearest to the same axis,
    and removes triangles with two equal corners. The two sides of a thin wall stay apart: merged, they have
    no normal, and are drawn with dark spots and holes."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    own = np.stack(
        [np.bincount(faces.ravel(), np.repeat(normals[:, axis], 3), len(vertices)) for axis in range(3)],
        axis=1,
    )
    side = np.argmax(np.concatenate([own, -own], axis=1), axis=1)
    cubes = np.column_stack([np.floor(vertices / size), side]).astype(np.int64)
    _, cell = np.unique(cubes, axis=0, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    means = np.stack([np.bincount(cell, vertices[:, axis]) / count for axis in range(3)], axis=1)
    merged = cell[faces]
    flat = (merged[:, 0] == merged[:, 1]) | (merged[:, 1] == merged[:, 2]) | (merged[:, 2] == merged[:, 0])
    return means, np.unique(merged[~flat], axis=0)


def disc(radius: float) -> tuple[Array, NDArray[np.intp]]:
    """Returns a hexagon of `radius` [m] perpendicular to the z axis."""
    angle = np.arange(6) * np.pi / 3.0
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(6)])
    faces = np.array([[0, k, k + 1] for k in range(1, 5)])
    return rim, faces


def towards(normal: Array) -> Array:
    """Returns the quaternion (4,) that turns the z axis to `normal`."""
    found = np.zeros(4)
    mujoco.mju_quatZ2Vec(found, normal)
    return found


def quaternion(rotation: Array) -> Array:
    """Returns the quaternion (4,) of a rotation matrix (3, 3)."""
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(rotation).ravel())
    return found
