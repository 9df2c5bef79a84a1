"""Replaces meshes by their convex hulls, which are sufficient for collisions. The meshes of a robot need
hundreds of MB."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import read_only
from tci.robot.model_file import compile_once
from tci.support.engine import mujoco

HULL_VERTICES = 64
"""Largest number of vertices of a mesh's convex hull. Assumed: more vertices take more time and have no
visible effect."""


def keep_hulls(spec: mujoco.MjSpec) -> None:
    """Removes geoms that never collide, and reduces each mesh to its convex hull. Only pictures need the
    removed geoms and vertices.

    The geoms of a link without `<inertial>` are not changed, because they define the mass of the link. A mesh
    that has no hull, such as a flat mesh, is not changed either.
    """
    weighed = {body.name for body in spec.bodies if body.explicitinertial}
    for geom in list(spec.geoms):
        if geom.parent.name in weighed and not (geom.contype or geom.conaffinity):
            spec.delete(geom)
    whole = {geom.meshname for geom in spec.geoms if geom.parent.name not in weighed}
    for mesh in list(spec.meshes):
        if mesh.name in whole:
            continue
        if not any(geom.meshname == mesh.name for geom in spec.geoms):
            spec.delete(mesh)
        elif (corners := _corners(spec, mesh)) is not None:
            _replace(mesh, corners)


def _replace(mesh: mujoco.MjsMesh, corners: NDArray[np.float32]) -> None:
    """Replaces the vertices of a mesh by `corners` (n, 3) [m]."""
    mesh.file = ""
    mesh.scale, mesh.refpos, mesh.refquat = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    mesh.uservert = corners.ravel()


def _corners(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> NDArray[np.float32] | None:
    """Returns the corners (n, 3) [m] of a mesh's convex hull in the frame of the mesh; None if the mesh has
    no hull."""
    file = Path(spec.modelfiledir, spec.meshdir, mesh.file)
    if not mesh.file or not file.is_file():
        return None
    place = (*mesh.scale, *mesh.refpos, *mesh.refquat)
    return _hull_of(str(file), file.stat().st_mtime_ns, tuple(map(float, place)), int(mesh.inertia))


@lru_cache(maxsize=1024)
def _hull_of(file: str, written: int, place: tuple[float, ...], inertia: int) -> NDArray[np.float32] | None:
    """Returns the corners (n, 3) [m] of the convex hull that MuJoCo computes for a mesh file; None if there
    is no hull. `written` is the time [ns] of the last change of the file. `place` contains MuJoCo's scale
    (3), refpos (3) and refquat (4) of the mesh, and `inertia` its mjtMeshInertia.
    """
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(
        name="mesh", file=file, maxhullvert=HULL_VERTICES,
        scale=place[:3], refpos=place[3:6], refquat=place[6:], inertia=mujoco.mjtMeshInertia(inertia),
    )  # fmt: skip
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
    try:
        model = compile_once(spec)
    except ValueError:
        return None
    begin = int(model.mesh_graphadr[0])
    if begin < 0:
        return None
    count = int(model.mesh_graph[begin])
    corners = model.mesh_vert[model.mesh_graph[begin + 2 + count : begin + 2 + 2 * count]]
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.mesh_quat[0])
    return read_only((corners @ R.reshape(3, 3).T + model.mesh_pos[0]).astype(np.float32))
