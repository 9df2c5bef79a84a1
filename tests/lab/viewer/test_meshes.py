"""Triangle meshes of link shapes are closed, face outward, and have the same size as MuJoCo's shapes."""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np
import pytest

from tci.lab.viewer.meshes import body_meshes

SHAPES = {
    "box": ("0.1 0.2 0.3", 8 * 0.1 * 0.2 * 0.3),
    "sphere": ("0.2", 4 / 3 * np.pi * 0.2**3),
    "ellipsoid": ("0.1 0.2 0.3", 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
    "capsule": ("0.1 0.2", 4 / 3 * np.pi * 0.1**3 + np.pi * 0.1**2 * 0.4),
    "cylinder": ("0.1 0.2", np.pi * 0.1**2 * 0.4),
}
"""Size and volume [m3] by type of geom."""


@pytest.mark.parametrize("kind", SHAPES)
def test_a_primitive_is_a_closed_surface_of_its_volume(kind: str) -> None:
    size, volume = SHAPES[kind]
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="{kind}" size="{size}"/></worldbody></mujoco>'
    )
    (mesh,) = body_meshes(model, set())
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    inside = float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum()) / 6.0  # negative if the faces point inward
    assert inside == pytest.approx(volume, rel=0.02)
    places = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)[1].ravel()[mesh.faces]
    edges = Counter((int(face[k]), int(face[k - 1])) for face in places for k in range(3))
    assert all(count == 1 and edges[edge[::-1]] == 1 for edge, count in edges.items())


def test_the_sides_of_a_thin_wall_stay_apart() -> None:
    """iCub's covers are shells of 2 mm: merged into one sheet, they had holes and dark spots."""
    count, half = 60, 0.05
    line = np.linspace(-half, half, count)
    x, y = (one.ravel() for one in np.meshgrid(line, line, indexing="ij"))
    dome = 0.02 * np.cos(20.0 * x)
    outer, inner = np.column_stack([x, y, dome]), np.column_stack([x, y, dome - 0.002])
    k = np.arange(count * count).reshape(count, count)
    a, b, c, d = (one.ravel() for one in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    above = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    rim = np.concatenate([k[:, 0], k[-1, 1:], k[-2::-1, -1], k[0, -2:0:-1]])
    after = np.roll(rim, -1)
    around = np.concatenate([
        np.column_stack([rim, rim + count**2, after + count**2]),
        np.column_stack([rim, after + count**2, after]),
    ])  # fmt: skip
    faces = np.concatenate([above, above[:, ::-1] + count**2, around])
    spec = mujoco.MjSpec()
    wall = spec.add_mesh(name="wall")
    wall.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    wall.uservert, wall.userface = np.concatenate([outer, inner]).ravel(), faces.ravel()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="wall")
    (mesh,) = body_meshes(spec.compile(), {0})
    assert len(mesh.faces) < 0.7 * len(faces)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    assert abs(float(np.einsum("fi,fi->f", a, normals).sum()) / 6.0) == pytest.approx(
        0.002 * (2 * half) ** 2, rel=0.1
    )
    # A vertex is drawn with the mean of its triangles' normals: its length is 0.38 at a corner of this wall.
    shaded, area = np.zeros_like(mesh.vertices), np.zeros(len(mesh.vertices))
    for corner in range(3):
        np.add.at(shaded, mesh.faces[:, corner], normals)
        np.add.at(area, mesh.faces[:, corner], np.linalg.norm(normals, axis=1))
    assert np.min(np.linalg.norm(shaded, axis=1) / area) > 0.35
