"""A model without the elements that only pictures need has the same collisions as the complete model."""

from __future__ import annotations

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tci.robot.hulls import HULL_VERTICES, keep_hulls

BALL = np.random.default_rng(5).normal(size=(400, 3))
BALL *= np.array([[0.1, 0.05, 0.03]]) / np.linalg.norm(BALL, axis=1, keepdims=True)
MJCF = """
<mujoco><asset>
  <mesh name="ball" file="ball.stl" scale="2 1 1" refpos="0.01 0 0"/>
  <mesh name="sheet" file="sheet.stl" inertia="shell"/>
</asset><worldbody>
  <body name="light"><joint/>
    <geom name="whole" type="mesh" mesh="{light}" contype="0" conaffinity="0"/></body>
  <body name="heavy" pos="0.5 0.3 0.1" euler="20 40 60"><joint/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom name="looks" type="mesh" mesh="ball" contype="0" conaffinity="0"/>
    <geom name="hits" type="mesh" mesh="ball" euler="10 20 30" pos="0.1 0 0"/></body>
  <body name="probe"><joint type="slide" axis="1 0 0"/><geom name="probe" size="0.01"/></body>
</worldbody></mujoco>
"""


def stl(path: Path, corners: NDArray[np.float64]) -> None:
    """Writes triangles (n, 3, 3) [m] to an STL file."""
    rows = [struct.pack("<12fH", 0, 0, 0, *corner.ravel(), 0) for corner in corners]
    path.write_bytes(bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows))


def spec_of(folder: Path, light: str) -> mujoco.MjSpec:
    hull = ConvexHull(BALL)
    stl(folder / "ball.stl", BALL[hull.simplices])
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    stl(folder / "sheet.stl", square[[[0, 1, 2], [0, 2, 3]]])
    (folder / "model.xml").write_text(MJCF.format(light=light))
    spec = mujoco.MjSpec.from_file(str(folder / "model.xml"))
    for mesh in spec.meshes:
        mesh.maxhullvert = HULL_VERTICES
    return spec


def distances(model: mujoco.MjModel, geom: str) -> list[float]:
    """Returns the distances [m] of a probe from a geom, measured from many sides."""
    data, found = mujoco.MjData(model), []
    probe = model.geom("probe").id
    for place in np.random.default_rng(3).uniform(-0.6, 0.9, size=(100, 3)):
        model.body_pos[model.body("probe").id] = place
        mujoco.mj_kinematics(model, data)
        found.append(mujoco.mj_geomDistance(model, data, probe, model.geom(geom).id, 5.0, None))
    return found


@pytest.mark.parametrize("light", ["ball", "sheet"])
def test_what_collides_is_where_it_was_and_weighs_what_it_weighed(tmp_path: Path, light: str) -> None:
    spec = spec_of(tmp_path, light)
    whole = spec.copy().compile()
    keep_hulls(spec)
    kept = spec.compile()
    assert distances(kept, "hits") == pytest.approx(distances(whole, "hits"), abs=1e-6)
    np.testing.assert_allclose(kept.body_mass, whole.body_mass)
    np.testing.assert_allclose(kept.body_inertia, whole.body_inertia)
    assert {kept.geom(number).name for number in range(kept.ngeom)} == {"whole", "hits", "probe"}


def test_a_mesh_becomes_its_hull_unless_a_mass_depends_on_it(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, "sheet")
    keep_hulls(spec)
    vertices = dict(zip(["ball", "sheet"], spec.compile().mesh_vertnum.tolist(), strict=True))
    assert vertices["ball"] <= HULL_VERTICES < len(ConvexHull(BALL).vertices)
    spec = spec_of(tmp_path, "ball")
    keep_hulls(spec)
    assert max(spec.compile().mesh_vertnum) == len(ConvexHull(BALL).vertices)
