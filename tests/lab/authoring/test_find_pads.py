"""Pads that a model already has, in small models of each kind and in models of other people."""

from __future__ import annotations

from pathlib import Path

import icub_models
import numpy as np
import pytest

from helpers.peers import peer_python
from tci.lab.authoring.find_pads import FoundPads, find_pads
from tci.lab.authoring.pad_patches import sensor_of
from tci.lab.authoring.pad_words import words

SIZES = {  # mm: across the finger, along it; and the rows and columns of Inspire's manual
    "index_force_sensor_1": (10.9, 14.3, 10, 8), "index_force_sensor_2": (11.0, 15.4, 12, 8),
    "index_force_sensor_3": (6.1, 4.7, 3, 3), "thumb_force_sensor_1": (11.8, 15.9, 12, 8),
    "thumb_force_sensor_2": (6.3, 6.3, 3, 3), "palm_force_sensor": (50.2, 30.4, 8, 14),
}  # fmt: skip
FIXED = """<joint name="{0}_j" type="fixed"><parent link="{1}"/><child link="{0}"/>
<origin xyz="{2}" rpy="{3}"/></joint>"""


def urdf(tmp_path: Path, text: str) -> FoundPads:
    path = tmp_path / "model.urdf"
    path.write_text(f'<robot name="r">{text}</robot>')
    return find_pads(path)


def mjcf(tmp_path: Path, text: str) -> FoundPads:
    path = tmp_path / "model.xml"
    path.write_text(f"<mujoco>{text}</mujoco>")
    return find_pads(path)


def boxed(name: str, size: str) -> str:
    box = f'<geometry><box size="{size}"/></geometry>'
    return f'<link name="{name}"><visual>{box}</visual><collision>{box}</collision></link>'


def hand(side: str) -> str:
    """A hand of boxes with the sizes of an Inspire hand's pads: fingers along z, pads on its front."""
    text = [boxed(f"{side}_base", "0.06 0.08 0.15")]
    for index, (name, (across, along, _, _)) in enumerate(SIZES.items()):
        pad = f"{side}_{name}"
        text.append(boxed(pad, f"{1e-3 * across} {1e-3 * along} 0.002"))
        # z of the pad's frame points into the hand: only the shapes tell which side is outside
        place = f"0.031 {-0.02 + 0.01 * index} 0.06"
        text.append(FIXED.format(pad, f"{side}_base", place, "1.5707963 0 -1.5707963"))
    return "".join(text)


def test_grids_are_fitted_to_the_outlines(tmp_path: Path) -> None:
    found = urdf(tmp_path, hand("left") + hand("right")
                 + FIXED.format("right_base", "left_base", "0 0.3 0", "0 0 0"))  # fmt: skip
    assert found.members == len(found.pads) == 2 * len(SIZES)
    for pad in found.pads:
        side, _, name = pad.link.partition("_")
        across, along, rows, columns = SIZES[name]
        assert pad.grid is not None
        assert pad.device is not None
        assert pad.device.name == "inspire-rh56dftp"
        assert (pad.grid.rows, pad.grid.columns, pad.taxels) == (rows, columns, rows * columns), pad.name
        assert pad.name.startswith(side)
        assert 1e3 * pad.thickness == pytest.approx(2.0, abs=0.1)
        # The taxels lie on the outer face, at half a pitch from the edges, with outward normals.
        np.testing.assert_allclose(pad.normals, np.tile([0.0, 0.0, -1.0], (pad.taxels, 1)), atol=0.02)
        np.testing.assert_allclose(pad.positions[:, 2], -1e-3, atol=2e-4)
        pitch = 1e-3 * np.array([across / columns, along / rows])
        extent = 1e-3 * np.array([across, along]) - pitch
        np.testing.assert_allclose(np.ptp(pad.positions[:, :2], axis=0), extent, atol=3e-4)


def test_a_pad_of_the_size_of_a_uskin_has_its_16_taxels(tmp_path: Path) -> None:
    joint = FIXED.format("left_tactile_pad", "gripper", "0 0 0.03", "0 0 0")
    (pad,) = urdf(
        tmp_path, boxed("gripper", "0.1 0.1 0.05") + boxed("left_tactile_pad", "0.0188 0.0188 0.005") + joint
    ).pads
    assert pad.device is not None
    assert pad.grid is not None
    assert (pad.device.name, pad.grid.rows, pad.grid.columns) == ("xela-uskin", 4, 4)
    np.testing.assert_allclose(np.ptp(pad.positions[:, :2], axis=0), 3 * 4.7e-3, atol=1e-5)
    assert sensor_of(pad).rest == 32768
    assert "xela:ADDRESS" in find_pads(tmp_path / "model.urdf").lines()[1], "the next step"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("LFsrFL_frame", ("l", "fsr", "fl", "frame")),
        ("HeadTouchFront_frame", ("head", "touch", "front", "frame")),
        ("r_lower_leg_skin_12", ("r", "lower", "leg", "skin")),
        ("link_15.0_tip_fsr", ("link", "tip", "fsr")),
        ("robot0:TS_palm_b0", ("robot", "ts", "palm", "b")),
        ("RHipSkinny", ("r", "hip", "skinny")),
    ],
)
def test_names_are_split_at_underscores_digits_and_camel_case(name: str, told: tuple[str, ...]) -> None:
    assert words(name) == told


def test_empty_links_count_as_taxels_and_modules(tmp_path: Path) -> None:
    names = ["LFsrFL_frame", "LFootBumperLeft_frame", "HeadTouchFront_frame"]
    modules = [f"l_forearm_skin_{n}" for n in (0, 2, 10)]
    text = boxed("base", "0.1 0.1 0.1")
    for name in (*names, "l_sole", "digit_link"):
        text += f'<link name="{name}"/>' + FIXED.format(name, "base", "0 0 0.05", "0 0 0")
    for place, name in enumerate(modules):
        text += f'<link name="{name}"/>' + FIXED.format(name, "base", f"{0.018 * place} 0 0.05", "0 0 0")
    text += '<gazebo reference="base"><sensor name="bump" type="contact"/></gazebo>'
    found = urdf(tmp_path, text)
    assert {pad.name: pad.taxels for pad in found.pads} == dict.fromkeys(names, 1) | {"l_forearm_skin": 30}
    assert found.pads[-1].modules == tuple(modules)
    assert found.members == 6
    for pad in found.pads:
        np.testing.assert_allclose(pad.normals[0], [0.0, 0.0, 1.0], atol=1e-9)
    assert [names for why, names in found.left_out.items() if "Gazebo" in why] == [("bump",)]


def test_a_taxel_without_shapes_looks_away_from_the_mass(tmp_path: Path) -> None:
    """A frame on the back of a hand whose z axis points along it, in a model without meshes: the touch sensor
    of Pepper's hands was taken to look sideways, and a reflex pressed it into who touched it."""
    heavy = """<inertial><origin xyz="0.035 0 -0.002" rpy="0 0 0"/><mass value="0.3"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>"""
    text = f'<link name="base"/><link name="wrist">{heavy}</link>' + FIXED.format(
        "wrist", "base", "0 0 1", "0 0 0"
    )
    text += '<link name="hand_touch"/>' + FIXED.format("hand_touch", "wrist", "0.05 0 0.03", "0 1.5707963 0")
    (pad,) = urdf(tmp_path, text).pads
    np.testing.assert_allclose(pad.normals[0], [-1.0, 0.0, 0.0], atol=1e-6)  # its -x is up, its z forward


@pytest.mark.parametrize("rows", [1, 2])
def test_frames_too_near_for_modules_are_taxels(tmp_path: Path, rows: int) -> None:
    """A fingertip with a frame for each taxel, named as modules are, whose middles are 18 mm apart. The y
    axes of its frames point inwards."""
    text, bent = boxed("tip", "0.008 0.02 0.01"), np.deg2rad([-40.0, 0.0, 40.0])
    for n, angle in enumerate(np.repeat(bent, rows).tolist()):
        place = f"{0.006 * np.sin(angle)} {0.004 * (n % rows)} {0.006 * np.cos(angle)}"
        text += f'<link name="l_index_skin_{n}"/>' + FIXED.format(
            f"l_index_skin_{n}", "tip", place, f"{-np.pi / 2} {angle} 0"
        )
    (pad,) = urdf(tmp_path, text).pads
    assert (pad.taxels, pad.modules, pad.link) == (3 * rows, (), "l_index_skin_0")
    # in the frame of the first, whose -y is outwards
    np.testing.assert_allclose(pad.normals[0], [0.0, -1.0, 0.0], atol=1e-9)
    turned = np.rad2deg(np.arccos(np.minimum(pad.normals @ pad.normals[0], 1.0)))
    np.testing.assert_allclose(turned, np.repeat([0.0, 40.0, 80.0], rows), atol=1e-5)


def test_sensors_of_mujoco(tmp_path: Path) -> None:
    found = mjcf(tmp_path, """
      <extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
      <asset><mesh name="pad" vertex="0 0 0 .01 0 0 0 .01 0 .01 .01 .001 0 0 .004"/></asset>
      <worldbody><body name="palm"><geom name="left_pad" type="box" size=".02 .03 .01"/>
        <site name="T_front" type="box" size=".004 .006 .001" pos="0 0 .01"/>
        <site name="thumb_touch" size=".005"/><site name="toe_touch" size=".005"/>
        <site name="grid" size=".005"/>
        <geom name="skin" type="mesh" mesh="pad"/>
        <body name="foot"><joint/><geom name="foot" size=".02"/></body>
        <body name="index_touch"><joint/><geom size=".01"/></body></body></worldbody>
      <sensor><touch name="TS_front" site="T_front"/>
        <plugin name="look" plugin="mujoco.sensor.touch_grid" objtype="site" objname="grid"><config key="size"
        value="4 2"/><config key="fov" value="180 90"/><config key="nchannel" value="3"/></plugin>
        <contact name="thumb" site="thumb_touch"/><contact name="foot" geom1="foot"/>
        <tactile name="felt" geom="skin" mesh="pad"/>
        <rangefinder name="far" site="grid"/></sensor>""")  # fmt: skip
    taxels = {pad.name: pad.taxels for pad in found.pads}
    assert taxels == {"TS_front": 1, "look": 8, "thumb": 1, "felt": 5}
    front = found.pads[0].grid
    assert front is not None
    assert sorted((front.length, front.width)) == pytest.approx([0.008, 0.012])
    np.testing.assert_allclose(found.pads[0].positions, [[0.0, 0.0, 0.011]], atol=1e-9)
    left = {name for names in found.left_out.values() for name in names}
    assert left == {"left_pad", "foot", "far", "toe_touch", "index_touch"}


def test_a_surface_is_offered_and_taken_only_when_asked(tmp_path: Path) -> None:
    text = boxed("base", "0.1 0.1 0.1") + boxed("left_pad", "0.02 0.03 0.004")
    text += FIXED.format("left_pad", "base", "0 0 0.052", "0 0 0")
    assert not urdf(tmp_path, text).pads
    (pad,) = find_pads(tmp_path / "model.urdf", also=["left_pad"]).pads
    assert (pad.link, pad.taxels) == ("left_pad", 1)
    (told,) = find_pads(tmp_path / "model.urdf", also=["left_pad"], wanted="flexitac").pads
    assert told.taxels == 12 * 32


def test_a_model_in_sdf(tmp_path: Path) -> None:
    path = tmp_path / "model.sdf"
    path.write_text("""<sdf version="1.9"><model name="m"><link name="finger"><pose>0 0 1 0 0 0</pose>
      <collision name="c"><geometry><box><size>.03 .03 .06</size></box></geometry></collision>
      <sensor name="bumper" type="contact"/></link>
      <link name="finger_tactile"><pose relative_to="finger">0.016 0 0 0 1.5707963 0</pose>
      <inertial><mass>0.001</mass></inertial>
      <visual name="v"><geometry><box><size>.0188 .0188 .002</size></box></geometry></visual></link>
      <joint name="j" type="fixed"><parent>finger</parent><child>finger_tactile</child></joint>
      </model></sdf>""")
    found = find_pads(path)
    (pad,) = found.pads
    assert (pad.link, pad.taxels, pad.solid) == ("finger_tactile", 16, False)
    np.testing.assert_allclose(pad.normals, np.tile([0.0, 0.0, 1.0], (16, 1)), atol=0.02)
    assert [names for why, names in found.left_out.items() if "Gazebo" in why] == [("bumper",)]


def test_sensors_of_tactile_toolbox(tmp_path: Path) -> None:
    array = '<array rows="16" cols="16" size="0.1 0.1" spacing="0.1 0.1"/>'
    path = tmp_path / "model.urdf"
    path.write_text(
        '<robot name="r" xmlns="http://www.ros.org"><link name="l"/>'
        f'<sensor name="a"><parent link="l"/><tactile>{array}</tactile></sensor>'
        f'<sensor name="b"><parent link="l"/><tactile><taxel idx="0"/>{array}</tactile></sensor></robot>'
    )
    assert {pad.name: pad.taxels for pad in find_pads(path).pads} == {"a": 256, "b": 1}


def test_a_link_with_sensors_is_their_frame(tmp_path: Path) -> None:
    found = mjcf(tmp_path, """
      <worldbody><body name="hand"><geom size=".02"/><body name="palm_force_sensor" pos="0 0 .03">
        <site name="t0" size=".005"/><site name="t1" pos=".01 0 0" size=".005"/></body></body></worldbody>
      <sensor><touch name="t0" site="t0"/><touch name="t1" site="t1"/></sensor>""")  # fmt: skip
    assert [pad.name for pad in found.pads] == ["t0", "t1"]


PEERS = {  # where the model lies in its package, and how many pads a person counts in it
    "gymnasium_robotics/envs/assets/hand/manipulate_block_touch_sensors.xml": 92 + 5,
    "gymnasium_robotics/envs/assets/hand/manipulate_block.xml": 5,
    "gymnasium_robotics/envs/assets/adroit_hand/adroit_pen.xml": 21,
    "dm_control/locomotion/walkers/assets/humanoid_CMU_V2020.xml": 10,
    "dm_control/third_party/ant/ant.xml": 9,
    "dm_control/locomotion/walkers/assets/dog_v2/dog.xml": 4,
    "dm_control/locomotion/walkers/assets/rodent.xml": 4,
    "dm_control/locomotion/walkers/assets/fruitfly_v2/fruitfly.xml": 6,
    "dm_control/suite/quadruped.xml": 0,
    "mani_skill/assets/robots/allegro/variation/allegro_hand_right_fsr.urdf": 16,
    "mani_skill/assets/robots/allegro/allegro_hand_right.urdf": 0,
}


def test_models_of_other_people() -> None:
    (packages,) = Path(peer_python("models")).parents[1].glob("lib/python*/site-packages")
    found = {name: find_pads(packages / name) for name in PEERS}
    assert {name: one.members for name, one in found.items()} == PEERS
    for name, distance in (("dm_control/third_party/ant/ant.xml", 8), ("dm_control/suite/quadruped.xml", 20)):
        (why,) = (why for why in found[name].left_out if "range finder" in why)
        assert len(found[name].left_out[why]) == distance


def test_icub_has_136_modules() -> None:
    found = find_pads(Path(icub_models.get_model_file("iCubGazeboV2_7")), meshes="none")
    assert found.members == 136
    assert {pad.name for pad in found.pads} == {
        "l_forearm_skin", "l_sole_skin", "r_forearm_skin", "r_lower_leg_skin", "r_sole_skin"
    }  # fmt: skip
