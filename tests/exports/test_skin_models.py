"""Skin for other programs: what MuJoCo and a plain reading of the URDF find in the exported files."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from lxml import etree
from scipy.spatial.transform import Rotation

from helpers.command_line import tci
from tci.exports import skin_to_mjcf, skin_to_urdf
from tci.exports.urdf import to_urdf
from tci.messages import SkinFrame
from tci.robot.catalogue import load_robot
from tci.robot.description import Grid, Patch, Robot
from tci.skin.surfaces import surfaces_of
from tci.wires.ros.cloud import PatchCloud


def padded() -> Robot:
    """A NAO with two grids on its left forearm, one of them mirrored."""
    nao = load_robot("nao")
    sleeve = nao.patch("left_forearm")
    plain = Grid(rows=3, columns=5, length=0.02, width=0.03, origin=(0.05, 0.01, 0.04), rpy=(0.3, -0.2, 1.0))
    grids = [plain, plain.model_copy(update={"mirrored": True, "order": "column-major"})]
    pads = [
        Patch(name=f"pad{n}", part=sleeve.part, link=sleeve.link, rate=50.0, channels=15,
              sensor=sleeve.sensor, surface=grid)
        for n, grid in enumerate(grids)
    ]  # fmt: skip
    return nao.model_copy(update={"patches": (*nao.patches, *pads)})


def placed(element: etree._Element) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = [float(word) for word in element.get("xyz").split()]
    pose[:3, :3] = Rotation.from_euler(
        "xyz", [float(word) for word in element.get("rpy").split()]
    ).as_matrix()
    return pose


def taxels(sensor: etree._Element) -> dict[int, np.ndarray]:
    """Poses of taxels by index, as the format's page says: row along x, column along y, z is the normal."""
    origin, array = placed(sensor.find("origin")), sensor.find("tactile/array")
    if array is None:
        return {int(one.get("idx")): origin @ placed(one) for one in sensor.iterfind("tactile/taxel")}
    rows, columns = int(array.get("rows")), int(array.get("cols"))
    spacing, offset = (np.array(array.get(key).split(), float) for key in ("spacing", "offset"))
    found = {}
    for row in range(rows):
        for column in range(columns):
            pose = np.eye(4)
            pose[:2, 3] = np.array([row, column]) * spacing - offset
            index = row * columns + column if array.get("order") == "row-major" else column * rows + row
            found[index] = origin @ pose
    return found


def test_taxels_are_where_they_were() -> None:
    robot = padded()
    root = etree.fromstring(skin_to_urdf(robot).encode())
    model = mujoco.MjModel.from_xml_string(skin_to_mjcf(robot))
    sensors = {one.get("name"): one for one in root.iterfind("sensor")}
    assert model.nsensor == sum(len(surface.positions) for surface in surfaces_of(robot))
    for surface in surfaces_of(robot):
        sensor = sensors[surface.patch]
        assert sensor.find("parent").get("link") == surface.link
        found = taxels(sensor)
        for channel, place, normal in zip(surface.channels, surface.positions, surface.normals, strict=True):
            np.testing.assert_allclose(found[channel][:3, 3], place, atol=1e-7)
            np.testing.assert_allclose(found[channel][:3, 2], normal, atol=1e-6)
            site = model.site(f"{surface.patch}_{channel}")
            assert model.body(int(model.site_bodyid[site.id])).name == surface.link
            np.testing.assert_allclose(site.pos, place, atol=1e-6)
            touch = model.sensor(f"{surface.patch}_{channel}")
            assert touch.type == mujoco.mjtSensor.mjSENS_TOUCH
            assert touch.objid == site.id


@pytest.mark.parametrize(("name", "own"), [("g1-inspire", 34), ("nao-whole", 0)])
def test_pads_are_links_of_the_served_model_and_clouds_are_in_their_frames(name: str, own: int) -> None:
    robot = load_robot(name)
    links = {one.get("name") for one in etree.fromstring(to_urdf(robot).encode()).iterfind("link")}
    frames = []
    for patch, surface in zip(robot.patches, surfaces_of(robot), strict=True):
        frame = SkinFrame(patch.name, 0.0, 0, np.full(patch.channels, patch.sensor.rest))
        frames.append(PatchCloud(patch, surface).values(frame, 1.0)[2])
    assert {*frames} <= links
    assert len({frame for frame in frames if "_force_sensor" in frame}) == own


def test_a_ball_on_a_pad_is_felt_by_the_taxels_below_it() -> None:
    """The pad is 3 mm thick, which only its description knows."""
    nao = load_robot("nao")
    chest = next(part for part in nao.parts if part.kind == "torso")
    assert nao.model is not None
    pad = Patch(
        name="pad", part=chest.name, link=nao.model.torso_link, rate=50.0, channels=12,
        sensor=nao.patches[0].sensor,
        surface=Grid(rows=3, columns=4, length=0.03, width=0.04, thickness=0.003, origin=(0.0, 0.0, 0.5)),
    )  # fmt: skip
    spec = mujoco.MjSpec.from_string(skin_to_mjcf(nao.model_copy(update={"patches": (pad,)})))
    here = surfaces_of(nao.model_copy(update={"patches": (pad,)}))[0].positions[5]
    ball = spec.body(pad.link).add_body(name="ball", pos=[*here[:2], here[2] + 0.0039])
    ball.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], stiffness=0)
    ball.add_geom(size=[0.004, 0, 0], mass=0.1)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    felt = {model.sensor(n).name: float(data.sensordata[n]) for n in range(model.nsensor)}
    assert max(felt, key=felt.__getitem__) == "pad_5"
    assert [name for name, force in felt.items() if force > 0.0] == ["pad_5"]


def test_the_command_writes_a_file(tmp_path: object) -> None:
    told = tci("skin", "export", "nao", "--to", "urdf", "--out", f"{tmp_path}/nao.urdf")
    assert "patches" in told
    assert "valid: urdf, mjcf" in tci("skin", "export", "nao", "--to", "sdf", status=1)
