"""Kinematic models in the forms in which others publish them, and damaged files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.robot.clearance import Clearance
from tci.robot.description import Model, Robot, Servo
from tci.robot.gravity import Gravity
from tci.robot.kinematics import KinematicChain, bare_model
from tci.robot.model_file import compiled, load_spec

MJCF = """
<mujoco><compiler angle="radian"/>{before}<worldbody>
  <body name="torso"><freejoint name="root"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom name="trunk" size="0.1"/><site name="imu"/>
    <body name="arm" pos="0 0.2 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="one" axis="0 1 0" range="-1 1"/>{geom}
    </body>
  </body>
  <body name="box"><freejoint/><geom size="0.1"/></body>
</worldbody>{after}</mujoco>
"""
HOME = """
<actuator><position name="motor" joint="one"/></actuator>
<sensor><accelerometer site="imu"/></sensor>
<keyframe><key name="home" qpos="0 0 1 1 0 0 0 0.3 5 0 0 1 0 0 0" ctrl="0.3"/></keyframe>
"""
URDF = """
<robot name="r"><link name="torso"/>
  <link name="arm"><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
  <joint name="one" type="revolute"><parent link="torso"/><child link="arm"/><origin xyz="0 0.2 0"/>
    <axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""


def robot_of(tmp_path: Path, text: str, format: Literal["mjcf", "urdf"]) -> Robot:
    path = tmp_path / f"model.{format}.xml"
    path.write_text(text)
    return Robot(
        name="r",
        source="r",
        digest=str(tmp_path),
        model=Model(format=format, path=str(path), torso_link="torso"),
        servos=(Servo(index=0, robot_part="arm", id=0, name="one", joint="one"),),
        parts=(),
    )


def mjcf(tmp_path: Path, *, before: str = "", geom: str = "", after: str = "") -> Robot:
    return robot_of(tmp_path, MJCF.format(before=before, geom=geom, after=after), "mjcf")


def test_a_floating_base_and_its_keyframe_are_left_out(tmp_path: Path) -> None:
    """Models of MuJoCo's own collection (Menagerie) have a floating base and a keyframe."""
    robot = mjcf(tmp_path, after=HOME)
    kinematics = KinematicChain(robot)
    assert robot.model is not None
    assert bare_model(robot.model).nq == 1
    pose = kinematics.poses(np.array([0.5]), ["arm"])["arm"]
    np.testing.assert_allclose(pose[:3, 3], [0.0, 0.2, 0.0], atol=1e-12)
    assert pose[0, 2] == pytest.approx(np.sin(0.5))
    assert Clearance(robot).servos == (0,)
    assert Gravity(robot).torques(np.array([0.5])) == pytest.approx([0.0])


def test_a_model_is_compiled_once_and_anew_when_its_file_changes(tmp_path: Path) -> None:
    """If one object, such as Gravity, changes its model, other objects are not affected."""
    robot = mjcf(tmp_path)
    assert robot.model is not None
    before = bare_model(robot.model)
    before.body_pos[:] = 1.0
    assert bare_model(robot.model).body("arm").pos.tolist() == [0.0, 0.2, 0.0]
    file = Path(robot.model.path)
    file.write_text(file.read_text().replace("0 0.2 0", "0 0.3 0"))
    assert bare_model(robot.model).body("arm").pos.tolist() == [0.0, 0.3, 0.0]


def test_a_fixed_link_without_inertial_has_no_mass(tmp_path: Path) -> None:
    """In a URDF, such a link has no mass. In an earlier version it had the mass that MuJoCo infers from its
    shapes: romeo_laas_small, whose collision shapes are links, had 165 kg instead of 41."""
    ball = '<collision><geometry><sphere radius="0.2"/></geometry></collision>'
    text = URDF.format(mesh="", axis="0 1 0").replace(
        '<link name="arm"><visual><geometry><mesh filename=""/></geometry></visual></link>',
        '<link name="arm"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        f'iyz="0"/></inertial></link><link name="shape">{ball}</link><joint name="fixed" type="fixed">'
        '<parent link="arm"/><child link="shape"/></joint>',
    )
    robot = robot_of(tmp_path, text, "urdf")
    assert robot.model is not None
    model = compiled(load_spec(robot.model), robot.model)
    assert model.body("shape").mass.tolist() == [0.0]
    assert model.body_mass.sum() == pytest.approx(2.0)
    assert Gravity(robot).torques(np.array([0.5])) == pytest.approx([0.0])


def test_a_file_without_any_inertial_keeps_the_masses_of_its_shapes(tmp_path: Path) -> None:
    """Otherwise links that move would have no mass, if their shapes belong to fixed links."""
    ball = '<collision><geometry><sphere radius="0.2"/></geometry></collision>'
    text = URDF.format(mesh="", axis="0 1 0").replace(
        '<link name="arm"><visual><geometry><mesh filename=""/></geometry></visual></link>',
        f'<link name="arm"/><link name="shape">{ball}</link><joint name="fixed" type="fixed">'
        '<parent link="arm"/><child link="shape"/></joint>',
    )
    robot = robot_of(tmp_path, text, "urdf")
    assert robot.model is not None
    assert compiled(load_spec(robot.model), robot.model).body("shape").mass > 1.0


def masses_of_shapes(tmp_path: Path, root: str, arm: str) -> list[float]:
    """Returns the masses [kg] of a root link with a shape, of a fixed link at this root with a shape, and of
    a link that moves. `root` and `arm` are the XML of their inertia."""
    ball = '<collision><geometry><sphere radius="0.2"/></geometry></collision>'
    text = URDF.format(mesh="", axis="0 1 0").replace(
        '<link name="torso"/>', f'<link name="torso">{root}{ball}</link>'
    )
    text = text.replace(
        '<link name="arm"><visual><geometry><mesh filename=""/></geometry></visual></link>',
        f'<link name="arm">{arm}{ball}</link><link name="shape">{ball}</link>'
        '<joint name="fixed" type="fixed"><parent link="torso"/><child link="shape"/></joint>',
    )
    robot = robot_of(tmp_path, text, "urdf")
    assert robot.model is not None
    model = compiled(load_spec(robot.model), robot.model)
    return [float(model.body(name).mass[0]) for name in ("torso", "shape", "arm")]


INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def test_the_root_of_a_file_without_any_inertial_keeps_the_mass_of_its_shapes(tmp_path: Path) -> None:
    """In an earlier version the trunk had no mass, and the limbs had the masses of their shapes."""
    trunk, fixed, arm = masses_of_shapes(tmp_path, "", "")
    assert trunk == fixed == arm > 1.0


@pytest.mark.parametrize("root", ["", INERTIAL])
def test_shapes_at_the_root_have_no_mass_if_the_file_has_masses(tmp_path: Path, root: str) -> None:
    trunk, fixed, arm = masses_of_shapes(tmp_path, root, INERTIAL)
    assert (trunk, fixed, arm) == (2.0 if root else 0.0, 0.0, 2.0)


@pytest.mark.parametrize("mesh", ["none.stl", "none.obj", "file:///none.dae", "."])
def test_a_mesh_that_is_missing_is_named(tmp_path: Path, mesh: str) -> None:
    robot = robot_of(tmp_path, URDF.format(mesh=mesh, axis="0 1 0"), "urdf")
    with pytest.raises(DescriptionError, match=f"mesh {mesh}: .* is not a file"):
        KinematicChain(robot)


def test_kinematics_need_no_mesh_of_mjcf_and_what_does_names_it(tmp_path: Path) -> None:
    robot = mjcf(
        tmp_path,
        before='<asset><mesh name="m" file="none.stl"/></asset>',
        geom='<geom type="mesh" mesh="m"/>',
    )
    KinematicChain(robot)
    with pytest.raises(DescriptionError, match=r"mesh none.stl: .* is not a file"):
        Clearance(robot)


MESH = '<compiler meshdir="shapes"/><asset><mesh name="m" file="m.stl"/></asset>'
FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])


def write_stl(path: Path, count: int) -> None:
    """Writes a binary STL file with `count` faces, which lie on one side of a tetrahedron or another."""
    sides = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])[sides]
    faces = np.zeros(count, FACE)
    faces["corners"] = corners[np.arange(count) % 4]
    path.write_bytes(bytes(80) + np.uint32(count).tobytes() + faces.tobytes())


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
def test_a_mesh_with_more_faces_than_mujoco_reads_is_refused_with_advice(
    tmp_path: Path, format: Literal["urdf", "mjcf"]
) -> None:
    """Meshes of b1 and go1 in example-robot-data have too many faces. An earlier version reported MuJoCo's
    own sentence ("perhaps this is an ASCII file?")."""
    (tmp_path / "shapes").mkdir()
    write_stl(tmp_path / "shapes" / "m.stl", 200_001)
    if format == "urdf":
        robot = robot_of(tmp_path, URDF.format(mesh="shapes/m.stl", axis="0 1 0"), format)
    else:
        robot = mjcf(tmp_path, before=MESH, geom='<geom type="mesh" mesh="m"/>')
    expected = r"mesh .*m.stl: has 200001 faces; MuJoCo reads at most 200000; valid: .* --without-meshes"
    with pytest.raises(DescriptionError, match=expected):
        Clearance(robot)
    assert robot.model is not None
    bare = robot.model.model_copy(update={"meshes": "none"})
    Clearance(robot.model_copy(update={"model": bare, "digest": "bare"}))


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
def test_an_stl_file_in_text_form_is_converted(tmp_path: Path, format: Literal["urdf", "mjcf"]) -> None:
    """An earlier version converted the file only for a URDF. For an MJCF, MuJoCo refused the file."""
    import trimesh

    (tmp_path / "shapes").mkdir()
    shape = trimesh.creation.box((0.2, 0.1, 0.1))
    (tmp_path / "shapes" / "m.stl").write_text(str(shape.export(file_type="stl_ascii")))
    if format == "urdf":
        text = URDF.replace("visual", "collision").format(mesh="shapes/m.stl", axis="0 1 0")
        robot = robot_of(tmp_path, text, format)
    else:
        robot = mjcf(tmp_path, before=MESH, geom='<geom type="mesh" mesh="m"/>')
    Clearance(robot)


def test_a_mesh_that_mujoco_refuses_comes_with_advice(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nf 1 1 1\n")
    robot = robot_of(tmp_path, URDF.format(mesh="m.obj", axis="0 1 0"), "urdf")
    with pytest.raises(DescriptionError, match=r"(?s)not a usable model: .*; valid: .* --without-meshes"):
        Clearance(robot)


def test_what_mujoco_finds_late_is_a_fault_of_the_file(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, URDF.format(mesh="", axis="0 0 0"), "urdf")
    with pytest.raises(DescriptionError, match=r"model.urdf.xml: 1 fault\n.*axis too small"):
        KinematicChain(robot)


def test_places_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    text = MJCF.format(before="", geom="", after="")
    for place in ("nan 0.2 0", "inf 0.2 0"):
        robot = robot_of(tmp_path, text.replace('pos="0 0.2 0"', f'pos="{place}"'), "mjcf")
        with pytest.raises(DescriptionError, match="not finite"):
            KinematicChain(robot)


def test_a_joint_that_the_model_lacks_is_named_where_links_collide_too(tmp_path: Path) -> None:
    robot = mjcf(tmp_path)
    lost = robot.servos[0].model_copy(update={"joint": "two"})
    with pytest.raises(DescriptionError, match="the model has no joint 'two'"):
        Clearance(robot.model_copy(update={"servos": (lost,), "digest": "lost"}))
