"""Descriptions are proposed for humanoids of all kinds: arms, elbows, heads and legs are mapped correctly, or
the model is refused with advice."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from lxml import etree

from helpers.made_humanoid import ARM, MadeHumanoid
from tci.cli.check import remarks
from tci.errors import DescriptionError
from tci.lab.authoring.left_out import left_out
from tci.lab.authoring.limb_kind import named_side
from tci.lab.authoring.proposal import propose
from tci.lab.authoring.sleeves import assumed_skins
from tci.lab.commissioning.plausibility import doubts
from tci.lab.experiments.verdict import compare_axes
from tci.robot.clearance import Clearance
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.robot.xml import read_robot
from tci.robot.xml.values import Angle, Number
from tci.robot.xml.writer import write_robot

LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")


def joints_of(robot: Robot, part: str) -> dict[str, str]:
    """Returns the name of the model's joint for each generic joint that is mapped."""
    found = {}
    for one in robot.part(part).servos:
        if one.servo is not None:
            found[one.name] = str(robot.servos[one.servo].joint)
    return found


def faults(path: Path, **options: object) -> str:
    with pytest.raises(DescriptionError) as error:
        propose(path, name="made", **options)
    return str(error.value)


def test_a_urdf_and_its_export_as_mjcf_give_one_robot(tmp_path: Path) -> None:
    made = MadeHumanoid()
    robots = [propose(file, name="made") for file in (made.urdf(tmp_path), made.mjcf(tmp_path))]
    assert [robot.model.format for robot in robots if robot.model] == ["urdf", "mjcf"]
    first, second = robots
    assert [part.name for part in first.parts] == [part.name for part in second.parts]
    for part in first.parts:
        assert joints_of(first, part.name) == joints_of(second, part.name)
        angles = [[one.initial for one in robot.part(part.name).servos] for robot in robots]
        np.testing.assert_allclose(*angles, atol=1e-6)
    assert [servo.limits.lower for servo in first.servos] == pytest.approx(
        [servo.limits.lower for servo in second.servos]
    )
    assert second.servos[0].limits.torque == 30.0
    assert "velocity" in second.servos[0].limits.assumed  # MJCF has no attribute for a speed limit
    again = tmp_path / "robot.xml"
    again.write_text(write_robot(second, file="made.xml"))
    assert joints_of(read_robot(again), "left_arm") == joints_of(second, "left_arm")
    for side in ("left", "right"):
        found = compare_axes(second, second.part(f"{side}_arm"))
        assert found.worst_deg < 1e-3
        assert set(joints_of(second, f"{side}_leg").values()) == {f"{side}_{name}" for name in LEG}


def test_speeds_are_written_as_a_person_reads_them(tmp_path: Path) -> None:
    robot = propose(MadeHumanoid().urdf(tmp_path), name="made")
    text = write_robot(robot, file="made.urdf")
    assert "359.82" in text, "6.28 rad/s"
    assert "359.8174" not in text
    assert not re.search(r"\.\d{7}|[ \"]-0[ \"]", text), "at most six places, and no negative zero"
    assert (Number().write(-1e-9), Angle().write(-1e-9)) == ("0", "0")


def test_a_file_that_is_no_model_is_named(tmp_path: Path) -> None:
    macro = tmp_path / "robot.urdf"
    macro.write_text(
        "<robot name='a' xmlns:xacro='http://ros.org/xacro'><xacro:include filename='b.xacro'/></robot>"
    )
    assert "xacro FILE.xacro > robot.urdf" in faults(macro)
    macro.write_text("<sdf/>")
    assert "starts with <sdf>" in faults(macro)


def test_legs_are_never_arms(tmp_path: Path) -> None:
    """The arms of this model are fixed, so its legs are its only moving limbs."""
    path = MadeHumanoid(arm=()).urdf(tmp_path)
    assert "left_hip_pitch,right_hip_pitch are legs" in faults(path)
    unnamed = MadeHumanoid(arm=(), names=False).urdf(tmp_path)
    assert "are legs" in faults(unnamed), "by their place alone"


def test_a_robot_with_one_arm_is_told_so(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text()
    for name in ARM:
        text = text.replace(
            f"<joint name='right_{name}' type='revolute'>", f"<joint name='right_{name}' type='fixed'>"
        )
    path.write_text(text)
    words = faults(path)
    assert "one arm only, at left_shoulder_pitch; valid: a robot with two arms" in words
    assert "legs" not in words


@pytest.mark.parametrize("legs", [True, False])
@pytest.mark.parametrize("chosen", [None, ("left_shoulder_pitch", "right_shoulder_pitch")])
def test_an_arm_that_is_missing_is_told_in_one_way(
    legs: bool, chosen: tuple[str, str] | None, tmp_path: Path
) -> None:
    """Legs are never offered as arms, and the model is not said to have no arm at all."""
    path = MadeHumanoid(legs=legs).urdf(tmp_path)
    root = etree.parse(str(path)).getroot()
    for joint in [one for one in root.findall("joint") if str(one.get("name")).startswith("right_")]:
        if str(joint.get("name")).removeprefix("right_") in ARM:
            child = joint.find("child").get("link")
            root.remove(joint)
            root.remove(next(link for link in root.findall("link") if link.get("name") == child))
    path.write_bytes(etree.tostring(root))
    words = faults(path, arms=chosen)
    assert "one arm only, at left_shoulder_pitch; valid: a robot with two arms" in words
    assert "hip" not in words


@pytest.mark.parametrize(("mass", "said"), [("nan", "mass nan kg"), ("inf", "mass inf kg")])
def test_a_mass_that_is_no_number_is_refused(mass: str, said: str, tmp_path: Path) -> None:
    assert said in faults(_weighing(tmp_path, mass))


def test_masses_that_are_assumed_or_that_no_link_has_are_told(tmp_path: Path) -> None:
    light = propose(_weighing(tmp_path, "0"), name="made")
    assert any("assumed mass of 1 g" in note and "left_elbow_link" in note for note in remarks(light))
    heavy = propose(_weighing(tmp_path, "1e12", link="torso"), name="made")
    assert any("link torso: mass 1e+12 kg; valid" in doubt for doubt in doubts(heavy))
    sound = propose(MadeHumanoid().urdf(tmp_path), name="made")
    assert not [line for line in (*remarks(sound), *doubts(sound)) if "mass" in line]


def _weighing(folder: Path, mass: str, *, link: str = "left_elbow_link") -> Path:
    """A model with another mass of one link."""
    path = MadeHumanoid().urdf(folder)
    root = etree.parse(str(path)).getroot()
    found = [one for one in root.findall("link") if one.get("name") == link]
    found[0].find("inertial").find("mass").set("value", mass)
    path.write_bytes(etree.tostring(root))
    return path


def test_a_side_at_the_end_of_a_name_is_read() -> None:
    assert [named_side(f"J14_SHOULDER_ROLL_{side}") for side in "LR"] == ["left", "right"]
    assert named_side("LARM_SHOULDER_R") == "left"
    assert named_side("NECK_ROLL") is None


def test_limbs_without_telling_names_are_told_apart_by_their_place(tmp_path: Path) -> None:
    robot = propose(MadeHumanoid(names=False).urdf(tmp_path), name="made")
    assert joints_of(robot, "left_arm")["shoulder_pitch"] == "left_0_0.15_0.3_0"
    assert joints_of(robot, "left_leg")["hip_pitch"] == "left_0_0.08_-0.05_0"


def test_sides_are_told_by_names_behind_the_limb_as_well(tmp_path: Path) -> None:
    """ARMAR-4 names the joints of its left arm `arml_sho1`, and its front direction is not one of the usual
    directions."""
    path = MadeHumanoid(legs=False, elbow=(-0.1, 2.2)).urdf(tmp_path)
    path.write_text(path.read_text().replace("left_", "armr_").replace("right_", "arml_"))
    assert joints_of(propose(path, name="made"), "left_arm")["elbow_pitch"] == "arml_elbow"


def test_names_that_tell_one_side_for_both_limbs_tell_none(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    text = re.sub(r"'left_(\w+)'", r"'\1_r0'", path.read_text())
    path.write_text(re.sub(r"'right_(\w+)'", r"'\1_r1'", text))
    robot = propose(path, name="made")
    assert joints_of(robot, "left_arm")["elbow_pitch"] == "elbow_r0"
    assert joints_of(robot, "right_leg")["hip_pitch"] == "hip_pitch_r1"


def test_place_and_names_that_contradict_each_other_are_an_error_with_a_choice(tmp_path: Path) -> None:
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    text = path.read_text()
    for name in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch"):
        text = text.replace(name, f"hip_knee_{ARM.index(name)}")
    path.write_text(text)
    assert "left_hip_knee_0,right_hip_knee_0 may be arms or legs; valid: --arms" in faults(path)
    chosen = propose(path, name="made", arms=("left_hip_knee_0", "right_hip_knee_0"))
    assert joints_of(chosen, "left_arm")["elbow_pitch"] == "left_hip_knee_3"
    assert "no arms start at the joints a,b" in faults(path, arms=("a", "b"))


@pytest.mark.parametrize("limits", [(-2.2, 0.1), (-2.2, 2.2)])
def test_an_elbow_bends_forward_even_if_its_limits_are_symmetric(
    limits: tuple[float, float], tmp_path: Path
) -> None:
    robot = propose(MadeHumanoid(elbow=limits).urdf(tmp_path), name="made")
    for side in ("left", "right"):
        servos = robot.part(f"{side}_arm").servos
        assert servos[3].scale == -1.0, "about y, a hanging forearm turns forward by negative angles"
        assert abs(servos[2].initial) < np.deg2rad(30.0)


def test_equal_arms_are_no_mirror_images(tmp_path: Path) -> None:
    """ARMAR-6 has the same arm twice: the right elbow bends forward only while its upper arm is turned half
    round. Its limits were blamed."""
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text()
    for joint, lower, upper in (("right_elbow", -0.1, 2.2), ("right_shoulder_yaw", -3.1, 3.1)):
        pattern = rf"(<joint name='{joint}'.*?)<limit lower='[^']*' upper='[^']*'"
        text = re.sub(pattern, rf"\1<limit lower='{lower}' upper='{upper}'", text, count=1)
    path.write_text(text)
    robot = propose(path, name="made")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for servo, angle in zip(robot.servos, initial_position(robot), strict=True):
        data.joint(servo.joint).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    for side, scale in (("left", -1.0), ("right", 1.0)):
        assert robot.part(f"{side}_arm").servos[3].scale == scale
        forearm = data.body(f"{side}_wrist_roll_link").xpos - data.body(f"{side}_elbow_link").xpos
        assert forearm[0] > 0.8 * float(np.linalg.norm(forearm))
    assert abs(data.joint("right_shoulder_yaw").qpos[0]) > 2.0


def test_an_elbow_that_may_bend_both_ways_is_asked_for(tmp_path: Path) -> None:
    """The elbow's axis points forward, so the shoulder can turn by 90 degrees in either direction to reach
    the generic zero."""
    path = MadeHumanoid(elbow=(-2.2, 2.2)).urdf(tmp_path)
    text = path.read_text()
    for side in ("left", "right"):
        start = text.index(f"<joint name='{side}_elbow'")
        end = text.index("</joint>", start)
        text = text[:start] + text[start:end].replace("0 1 0", "1 0 0") + text[end:]
    path.write_text(text)
    assert "valid: --elbow 1 or --elbow -1" in faults(path)
    for elbow in (1, -1):
        servos = [
            propose(path, name="made", elbow=elbow).part(f"{side}_arm").servos[3]
            for side in ("left", "right")
        ]
        assert [servo.scale for servo in servos] == [elbow, -elbow], "mirrored"


def test_arms_of_four_joints_end_with_their_shape(tmp_path: Path) -> None:
    robot = propose(MadeHumanoid(arm=ARM[:4]).urdf(tmp_path), name="made")
    part = robot.part("left_arm")
    assert part.servos[4].servo is None
    assert part.segment("forearm").length == pytest.approx(0.18, abs=0.02), "the shape ends 0.18 m down"
    assert any(patch.segment == "forearm" for patch in robot.patches)


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        (("yaw", "pitch"), {"yaw": "head_0_yaw", "pitch": "head_1_pitch"}),
        (("pitch", "yaw", "pitch"), {"pitch": "head_0_pitch", "yaw": "head_1_yaw"}),
    ],
)
def test_heads_off_the_median_plane_and_with_parallel_joints(
    head: tuple[str, ...], expected: dict[str, str], tmp_path: Path
) -> None:
    robot = propose(MadeHumanoid(head=head).urdf(tmp_path), name="made")
    assert joints_of(robot, "head") == expected


def test_a_waist_below_the_root_turns_the_torso_the_other_way(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("pelvis", "torso")]
    for folder in folders:
        folder.mkdir()
    made = [MadeHumanoid(from_torso=from_torso) for from_torso in (False, True)]
    scales = []
    for humanoid, folder in zip(made, folders, strict=True):
        robot = propose(humanoid.urdf(folder), name="made")
        assert joints_of(robot, "torso") == {"yaw": "waist_yaw"}
        scales.append(robot.part("torso").servos[2].scale)
        assert set(joints_of(robot, "left_leg").values()) == {f"left_{name}" for name in LEG}
    assert scales == [1.0, -1.0]


@pytest.mark.parametrize("slant", [0.0, 0.5])
def test_legs_with_slanted_hips_are_found(slant: float, tmp_path: Path) -> None:
    robot = propose(MadeHumanoid(slant=slant).urdf(tmp_path), name="made")
    for side in ("left", "right"):
        assert set(joints_of(robot, f"{side}_leg").values()) == {f"{side}_{name}" for name in LEG}


@pytest.mark.parametrize("from_torso", [False, True])
def test_legs_that_are_left_out_are_told_with_the_reason(from_torso: bool, tmp_path: Path) -> None:
    steep = propose(MadeHumanoid(slant=0.8, from_torso=from_torso).urdf(tmp_path), name="steep")
    assert not [part for part in steep.parts if part.kind == "leg"]
    words = "no legs: left_hip_pitch and right_hip_pitch are slanted by 53 degrees"
    assert [note for note in left_out(steep) if words in note]
    assert left_out(propose(MadeHumanoid(from_torso=from_torso).urdf(tmp_path), name="made")) == []


def test_a_torso_that_slides_is_told(tmp_path: Path) -> None:
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    lift = (
        "<link name='column'><inertial><mass value='3'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' "
        "iyz='0'/></inertial></link><joint name='lift' type='prismatic'><parent link='column'/>"
        "<child link='torso'/><axis xyz='0 0 1'/><limit lower='0' upper='.3' effort='9' velocity='.1'/>"
        "</joint>"
    )
    text = path.read_text().replace("<child link='torso'/>", "<child link='column'/>")
    path.write_text(text.replace("</robot>", f"{lift}</robot>"))
    robot = propose(path, name="made")
    assert "waist_yaw" in {servo.name for servo in robot.servos}
    assert left_out(robot) == ["lift: no generic joint slides; at the model's zero in simulation"]


def test_exchanged_names_of_the_sides_are_one_of_the_causes_that_are_told(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text().replace("left_", "?_").replace("right_", "left_").replace("?_", "right_")
    path.write_text(text)
    with pytest.raises(DescriptionError, match="the names left and right are not exchanged"):
        propose(path, name="made")


def test_joints_of_a_neck_that_are_left_out_are_told(tmp_path: Path) -> None:
    path = MadeHumanoid(head=("yaw",)).urdf(tmp_path)
    text = path.read_text()
    start = text.index("<joint name='head_0_yaw'")
    path.write_text(text[:start] + text[start:].replace("0 0 1", "0 0.6 0.8", 1))
    robot = propose(path, name="made")
    assert joints_of(robot, "head") == {}
    assert [note for note in left_out(robot) if note.startswith("no head: head_0_yaw; they turn")]


def test_a_root_beside_the_median_plane_does_not_matter(tmp_path: Path) -> None:
    path = MadeHumanoid(from_torso=True).urdf(tmp_path)
    plain = propose(path, name="made")

    def aside(found: re.Match[str]) -> str:
        x, y, z = found[2].split()
        return f"{found[1]}{x} {float(y) + 0.13} {z}"

    path.write_text(
        re.sub(r"(<parent link='torso'/><child [^>]*><origin xyz=')([^']*)", aside, path.read_text())
    )
    moved = propose(path, name="made")
    assert moved.model is not None
    assert moved.model.torso_xyz == pytest.approx((0.0, 0.13, 0.0))
    assert plain.model is not None
    assert plain.model.torso_xyz == (0.0, 0.0, 0.0)
    assert [part.name for part in moved.parts] == [part.name for part in plain.parts]
    for part in plain.parts:
        assert joints_of(moved, part.name) == joints_of(plain, part.name)
        for one, other in zip(moved.part(part.name).servos, part.servos, strict=True):
            assert (one.scale, one.offset) == pytest.approx((other.scale, other.offset))
    links = ["left_shoulder_pitch_link", "right_shoulder_pitch_link"]
    poses = KinematicChain(moved).poses(np.zeros(len(moved.servos)), links)
    assert poses[links[0]][1, 3] == pytest.approx(-poses[links[1]][1, 3])


def test_placeholders_far_away_do_not_matter(tmp_path: Path) -> None:
    path = MadeHumanoid().mjcf(tmp_path)
    far = "<body name='unused' pos='0 0 20'><joint name='unused'/><geom size='.1'/></body></worldbody>"
    path.write_text(path.read_text().replace("</worldbody>", far))
    robot = propose(path, name="made")
    assert set(joints_of(robot, "left_leg").values()) == {f"left_{name}" for name in LEG}


def test_all_missing_meshes_are_listed_and_can_be_left_out_or_found(tmp_path: Path) -> None:
    import trimesh

    path = MadeHumanoid(mesh="shapes").urdf(tmp_path)
    with pytest.raises(DescriptionError) as error:
        propose(path, name="made")
    words = str(error.value)
    assert words.count("is not a file") == len(error.value.faults) == 1, "one line for one missing folder"
    assert f"({2 + 2 + 2 * (6 + 6) - 1} others of {tmp_path / 'shapes'} are missing too)" in words
    assert "--without-meshes" in words
    bare = propose(path, name="made", meshes="none")
    assert len(bare.patches) == 4
    target = tmp_path / "robot.xml"
    target.write_text(write_robot(bare, file=path.name, meshes="none"))
    assert read_robot(target).model == bare.model
    folder = tmp_path / "elsewhere" / "meshes"
    folder.mkdir(parents=True)
    for link in [word.split("/")[1].split(".")[0] for word in path.read_text().split("filename='")[1:]]:
        trimesh.creation.cylinder(0.03, 0.2).export(folder / f"{link.upper()}.STL")
    found = propose(path, name="made", meshes=str(folder.parent))
    assert {patch.name for patch in found.patches} == {patch.name for patch in bare.patches}
    (tmp_path / "shapes").symlink_to(folder)
    assert "did you mean 'PELVIS.STL'? Upper and lower case count" in faults(path)


def test_a_shape_of_size_zero_names_its_link(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    path.write_text(path.read_text().replace("radius='0.1'", "radius='0'"))
    assert "the shape of pelvis" in faults(path)


def test_frames_drawn_as_shapes_of_size_zero_are_left_out(tmp_path: Path) -> None:
    """Published models (ARMAR-4, human-gazebo) contain shapes of size zero that mark frames."""
    path = MadeHumanoid().urdf(tmp_path)
    usual = propose(path, name="made")
    shapes = ("<sphere radius='0.00'/>", "<box size='0   0 0'/>")
    drawn = "".join(
        f"<{tag}><geometry>{shape}</geometry></{tag}>" for shape in shapes for tag in ("visual", "collision")
    )
    path.write_text(path.read_text().replace("</link>", f"{drawn}</link>"))
    assert propose(path, name="made").patches == usual.patches


def test_a_fault_of_a_urdf_names_its_line(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text().replace("</link>", "</link>\n<!-- a\n comment -->\n")
    text = text.replace("axis xyz='0 0 1'", "axis xyz='up'", 1)
    text = f"<?xml version='1.0'?>\n<!-- on\n two lines -->\n{text}"
    path.write_text(text)
    line = next(number for number, words in enumerate(text.split("\n"), 1) if "'up'" in words)
    assert f"line {line}" in faults(path)
    shape = "<link name='pelvis'>\n<visual>\n<geometry><sphere radius='0.1'/></geometry>\n</visual>"
    text = text.replace("<link name='pelvis'>", shape, 1)
    path.write_text(text)
    assert f"line {line + 3}" in faults(path, meshes="none"), "shapes that are left out keep their lines"


def test_a_comma_between_numbers_is_read_as_ros_reads_it(tmp_path: Path) -> None:
    path = MadeHumanoid().urdf(tmp_path)
    plain = propose(path, name="made")
    text = path.read_text()
    path.write_text(re.sub(r"xyz='(\S+) (\S+) (\S+)'", r"xyz='\1, \2 \3'", text))
    assert path.read_text() != text
    assert propose(path, name="made").parts == plain.parts


def test_arms_without_shapes_get_skin_from_their_lengths_and_a_note(tmp_path: Path) -> None:
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    assert assumed_skins(propose(path, name="made")) == []
    text = path.read_text()
    for side in ("left", "right"):
        for name in ARM:
            start = text.index(f"<link name='{side}_{name}_link'>")
            begin, end = text.index("<collision>", start), text.index("</collision>", start)
            text = text[:begin] + text[end + len("</collision>") :]
    path.write_text(text)
    robot = propose(path, name="made")
    assert len(robot.patches) == 4
    (note,) = assumed_skins(robot)
    assert "left_forearm (36 mm)" in note
    assert "no shapes of the model tell it" in note


def test_limits_of_the_other_side_are_refused(tmp_path: Path) -> None:
    """In a published model (simple_humanoid) the limits let the right arm move only into the body."""
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text()
    for side in ("left", "right"):
        start = text.index(f"<joint name='{side}_shoulder_roll'")
        text = text[:start] + text[start:].replace("lower='-1.5' upper='1.5'", "lower='0.6' upper='2.8'", 1)
    path.write_text(text)
    words = faults(path)
    assert "right_arm: the arm can't hang down with its forearm forward" in words
    needs = r"joint {} would need -?\d+ degrees, and its limits are {} to {} degrees"
    assert re.search(needs.format("right_shoulder_roll", 34, 160), words)
    assert re.search(needs.format("left_elbow", -126, 6), faults(MadeHumanoid().urdf(tmp_path), elbow=1))


def test_inertias_in_other_units_are_refused(tmp_path: Path) -> None:
    """A hand of a published model (orcabot) has an inertia of 121 kg m2; Reachy's shoulders, 0.16 kg each,
    have 79 000: g mm2."""
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text()
    start = text.index("<link name='left_wrist_pitch_link'>")
    heavy = "ixx='121' iyy='121' izz='121'"
    path.write_text(text[:start] + text[start:].replace("ixx='.01' iyy='.01' izz='.01'", heavy, 1))
    words = faults(path)
    assert "left_shoulder_pitch: its torque of 30 N m can't move the 121 kg m2" in words
    assert re.search(r"such as link left_wrist_pitch_link of \S+ kg and 121 kg m2", words)
    assert "in kg and kg m2" in words


def test_shapes_beside_their_limb_are_refused(tmp_path: Path) -> None:
    """In one published iCub model, the meshes lie 7 to 9 cm away from the axes of the arms."""
    path = MadeHumanoid().urdf(tmp_path)
    text = path.read_text()
    for side in ("left", "right"):
        for name in ("elbow", "wrist_roll"):
            start = text.index("<collision>", text.index(f"<link name='{side}_{name}_link'>"))
            text = text[:start] + text[start:].replace("0 0 -0.08", "0.08 0 -0.08", 1)
    path.write_text(text)
    words = faults(path)
    assert "lie 80 mm beside the axis of left_arm's forearm" in words
    assert "valid: --no-sleeves, --without-meshes" in words
    assert not propose(path, name="made", cover=False).patches
    bare = propose(path, name="made", meshes="none")
    assert len(bare.patches) == 4


def test_the_initial_posture_is_clear_of_the_body(tmp_path: Path) -> None:
    """The torso is as wide as Baxter's. If an initial posture brought links into contact with the torso,
    these links could not move."""
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    usual = propose(path, name="made").part("left_arm").initial_posture
    text = path.read_text()
    end = text.index("</link>", text.index("<link name='torso'>"))
    shape = "<geometry><box size='0.2 0.46 0.1'/></geometry>"
    path.write_text(f"{text[:end]}<collision><origin xyz='0 0 0.1'/>{shape}</collision>{text[end:]}")
    robot = propose(path, name="wide")
    part = robot.part("left_arm")
    assert part.initial_posture[1] > usual[1], "farther from the body"
    gap = Clearance(robot).gap(np.array(initial_position(robot)), within=1.0)
    assert gap.distance > 0.01, gap


def test_the_initial_posture_does_not_twist_a_shoulder(tmp_path: Path) -> None:
    """At the model's zero the arms point forward and the elbows bend down, as on Baxter."""
    robot = propose(MadeHumanoid(ahead=True, legs=False).urdf(tmp_path), name="made")
    position = initial_position(robot)
    for side in ("left", "right"):
        turns = [position[one.servo] for one in robot.part(f"{side}_arm").servos[:3] if one.servo is not None]
        assert np.abs(turns).max() < np.deg2rad(120.0)
        assert robot.part(f"{side}_arm").initial_posture[3] > np.deg2rad(40.0), "the forearm is ahead"
