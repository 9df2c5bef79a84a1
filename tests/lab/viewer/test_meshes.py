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
