"""`tci new-robot`."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers import made_hands
from helpers.command_line import tci
from helpers.made_hands import with_hands
from helpers.made_humanoid import MadeHumanoid
from tci.lab.authoring.proposal import propose
from tci.robot.clearance import Clearance
from tci.robot.description import Grid
from tci.robot.xml import read_robot
from tci.robot.xml.model import packaged
from tci.robot.xml.writer import write_robot


def test_from_a_folder_and_from_a_package(tmp_path: Path) -> None:
    urdf = packaged("example-robot-data", "g1_description/urdf/g1_29dof_rev_1_0.urdf")
    assert urdf is not None
    own = (
        tmp_path / "example-robot-data" / "robots" / "g1_description"
    )  # the package that the mesh paths contain
    shutil.copytree(urdf.parent.parent, own)
    model = own / "urdf" / urdf.name
    told = json.loads(tci("new-robot", str(model), "--name", "mine", "--json"))
    robot = read_robot(told["file"])
    assert robot.name == "mine"
    assert len(robot.patches) == 4
    assert any("shoulder_pitch = left_shoulder_pitch_joint (retarget)" in line for line in told["found"])
    assert "exists" in tci("new-robot", str(model), status=1)
    assert "--package" in tci("new-robot", str(model), "--out", str(tmp_path / "x" / "robot.xml"), status=1)
    out = tmp_path / "elsewhere" / "robot.xml"
    tci("new-robot", str(urdf), "--package", "example-robot-data", "--out", str(out))
    assert read_robot(out).parts == robot.parts
    tci("new-robot", urdf.name, "--package", "example-robot-data", "--out", str(out), "--force")
    assert read_robot(out).parts == robot.parts
    told = tci("new-robot", "no.urdf", "--package", "example-robot-data", "--out", str(out), status=1)
    assert "has no model 'no.urdf'" in told
    assert "g1_description/urdf/g1_29dof_rev_1_0.urdf" in told


def with_pads(model: Path) -> None:
    """Adds a pad with the size of an Inspire hand's pad, and an empty link, to the index fingers and arms."""
    text = model.read_text()
    extra = ""
    for side in ("left", "right"):
        index, arm = f"{side}_index_proximal_link", f"{side}_elbow_link"
        box = '<geometry><box size="0.0109 0.0020 0.0143"/></geometry>'
        pad, bumper = f"{side}_index_force_sensor_1", f"{side}_arm_bumper"
        extra += f'<link name="{pad}"><visual>{box}</visual></link><link name="{bumper}"/>'
        for child, parent, place in ((pad, index, "0 0.008 -0.02"), (bumper, arm, "0.04 0 -0.05")):
            extra += f'<joint name="{child}_joint" type="fixed"><parent link="{parent}"/>'
            extra += f'<child link="{child}"/><origin xyz="{place}"/></joint>'
    model.write_text(text.replace("</robot>", f"{extra}</robot>"))


def test_pads_of_the_model_are_its_skin(tmp_path: Path) -> None:
    model = with_hands(MadeHumanoid(legs=False).urdf(tmp_path), made_hands.inspire())
    bare = tci("new-robot", str(model))
    assert bare.rstrip().endswith("no skin in this model: sleeves are assumed (--no-sleeves)")
    sleeves = read_robot(tmp_path / "robot.xml").patches
    assert len(sleeves) == 4
    assert all(patch.assumed for patch in sleeves)
    assert "assumed skin" in tci("check", str(tmp_path / "robot.xml"))
    tci("new-robot", str(model), "--force", "--no-sleeves")
    assert not read_robot(tmp_path / "robot.xml").patches
    with_pads(model)
    told = tci("new-robot", str(model), "--force")
    assert "4 pads in the model, 162 taxels" in told
    assert "4 pads in the model, 162 taxels" in (tmp_path / "robot.xml").read_text()
    robot = read_robot(tmp_path / "robot.xml")
    assert {patch.name: (patch.part, patch.segment, patch.channels) for patch in robot.patches} == {
        "left_index_pad": ("left_fingers", "index", 80), "left_arm_bumper": ("left_arm", "forearm", 1),
        "right_index_pad": ("right_fingers", "index", 80), "right_arm_bumper": ("right_arm", "forearm", 1),
    }  # fmt: skip
    # The model shows the pad only in pictures, so its thickness is in the description, and collides.
    grid = robot.patch("left_index_pad").surface
    assert isinstance(grid, Grid)
    assert 1e3 * grid.thickness == pytest.approx(2.0, abs=0.1)
    solid = Clearance(robot).model
    pad = solid.geom("tci_pad_left_index_pad")
    assert 2e3 * pad.size[2] == pytest.approx(2.0, abs=0.1)
    assert pad.contype[0] or pad.conaffinity[0]
    tci("new-robot", str(model), "--force", "--sleeves")
    assert sum(patch.assumed for patch in read_robot(tmp_path / "robot.xml").patches) == 4


def spoilt(text: str, joint: str, **limits: float) -> str:
    """The URDF with other limits of a joint of both arms."""
    for side in ("left", "right"):
        begin = text.index(f"<joint name='{side}_{joint}'")
        end = text.index("</joint>", begin)
        own = text[begin:end]
        for name, value in limits.items():
            own = re.sub(rf" {name}='[^']*'", f" {name}='{value}'", own)
        text = text[:begin] + own + text[end:]
    return text


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (lambda text: re.sub("(<link name='left_elbow_link'>)<inertial>.*?</inertial>", r"\1", text),
         "link left_elbow_link moves and has no <inertial>; valid: an <inertial>"),
        (lambda text: spoilt(text, "wrist_roll", lower=-0.001, upper=0.001),
         "left_arm: its limits allow 0 of 400 common postures; valid: at least 25%"),
        (lambda text: spoilt(text, "shoulder_pitch", effort=2.0),
         "left_shoulder_pitch: torque limit of 2 N m; the weight of the arm, stretched out, takes 6.13 N m"),
    ],
)  # fmt: skip
def test_what_check_refuses_is_not_written_and_all_commands_agree(
    mistake: Callable[[str], str], words: str, tmp_path: Path
) -> None:
    model, file = MadeHumanoid().urdf(tmp_path), tmp_path / "robot.xml"
    model.write_text(mistake(model.read_text()))
    assert words in tci("new-robot", str(model), status=1)
    assert not file.exists()
    file.write_text(write_robot(propose(model, name="made"), file=model.name))
    for command in (["check"], ["check", "--simulate"], ["skin", "check"]):
        assert words in tci(*command, str(file), status=1)


def symmetric_fingers(folder: Path) -> Path:
    return with_hands(MadeHumanoid(legs=False).urdf(folder), made_hands.allegro(), limits=(-1.0, 1.0))


def elbow_of_both_ways(folder: Path) -> Path:
    path = MadeHumanoid(elbow=(-2.2, 2.2), legs=False).urdf(folder)
    path.write_text(re.sub(r"(_elbow' .*?<axis xyz=)'0 1 0'", r"\1'1 0 0'", path.read_text()))
    return path


def no_meshes(folder: Path) -> Path:
    return MadeHumanoid(mesh="shapes", legs=False).urdf(folder)


def shapes_beside(folder: Path) -> Path:
    path = MadeHumanoid(legs=False).urdf(folder)
    shape = "<cylinder radius='0.03' length='0.2'/>"
    text = path.read_text()
    for name in ("left_elbow", "left_wrist_roll", "right_elbow", "right_wrist_roll"):
        start = text.index(shape, text.index(f"<link name='{name}_link'>")) - 120
        text = text[:start] + text[start:].replace("xyz='0 0 -0.08'", "xyz='0.08 0 -0.08'", 1)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("model", "options"),
    [
        (symmetric_fingers, {"--fingers none"}),
        (elbow_of_both_ways, {"--elbow 1", "--elbow -1"}),
        (no_meshes, {"--without-meshes"}),
        (shapes_beside, {"--no-sleeves", "--without-meshes"}),
    ],
)
def test_every_option_that_a_refusal_offers_is_followed_with_success(
    model: Callable[[Path], Path], options: set[str], tmp_path: Path
) -> None:
    path = model(tmp_path)
    words = tci("new-robot", str(path), status=1)
    offered = re.findall(r"--(?:fingers [a-z]+|elbow -?1|without-meshes|no-sleeves)", words)
    assert set(offered) == options
    for option in offered:
        tci("new-robot", str(path), "--force", *option.split())


@pytest.mark.parametrize("angle", ["degree", "radian"])
def test_radians_are_only_for_a_file_that_tells_no_unit(angle: str, tmp_path: Path) -> None:
    """The unit that a file told was replaced in silence."""
    words = f'<mujoco><compiler angle="{angle}"/><worldbody/></mujoco>'
    (tmp_path / "hand.xml").write_text(words)
    said = tci("new-robot", str(tmp_path / "hand.xml"), "--radians", status=1)
    assert f"--radians: hand.xml counts angles in {angle}s; valid: with an MJCF that tells no unit" in said
    assert not (tmp_path / "robot.xml").exists()


def test_radians_are_not_for_a_urdf(tmp_path: Path) -> None:
    said = tci("new-robot", str(MadeHumanoid().urdf(tmp_path)), "--radians", status=1)
    assert "counts angles in radians; valid: with an MJCF that tells no unit" in said
