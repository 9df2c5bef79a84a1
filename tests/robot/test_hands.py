"""Models of hands: joints that follow a servo, hand models that are attached to a robot, and descriptions
that extend another description."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.gate.gate import Gate
from tci.messages import JointReading, Mode, PlatformCommand
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.xml import read_robot
from tci.simulation.world import World

HANDS = ("icub-hands", "nao-hands", "g1-hands", "g1-inspire")


def fist(robot: Robot, share: float) -> np.ndarray:
    """Returns the angles (n_servos,) [rad] of a robot whose left hand is closed by a fraction 0..1."""
    position = np.array(initial_position(robot))
    for servo in joint_map(robot, "left_fingers").servos.tolist():
        limits = robot.servos[servo].limits
        assert limits.lower is not None
        assert limits.upper is not None
        position[servo] = limits.lower + share * (limits.upper - limits.lower)
    return position


@pytest.mark.parametrize("name", HANDS)
def test_fingers_are_where_the_physics_has_them(name: str) -> None:
    """After the servos have moved, palm and finger tips are at equal positions in the robot's kinematics and
    in the simulation."""
    robot = load_robot(name)
    world = World(robot, skin=False)
    kinematics = KinematicChain(robot)
    wanted = fist(robot, 0.6)
    world.set_position_targets(np.arange(len(wanted)), wanted)
    world.advance(3.0)
    joints = world.joints().position
    np.testing.assert_allclose(joints, wanted, atol=np.deg2rad(0.5))
    links = [s.link for s in robot.part("left_fingers").segments]
    poses = kinematics.poses(joints, links)
    world.refresh()
    torso = np.linalg.inv(world.torso)
    for link in links:
        body = world.data.body(link)
        there = torso @ np.append(body.xpos, 1.0)
        np.testing.assert_allclose(poses[link][:3, 3], there[:3], atol=2e-4, err_msg=link)


@pytest.mark.parametrize("name", HANDS)
def test_the_jacobian_of_a_tip_is_its_derivative(name: str) -> None:
    robot = load_robot(name)
    kinematics, here, step = KinematicChain(robot), fist(robot, 0.3), 1e-6
    for segment in robot.part("left_fingers").segments:
        point = np.array([0.02, 0.003, -0.001])
        found = kinematics.jacobian(here, segment.link, point=point)[:3]
        for servo in kinematics.chain(segment.link):
            ends = [np.array(here), np.array(here)]
            ends[0][servo] -= step
            ends[1][servo] += step
            places = [kinematics.pose_and_jacobian(end, segment.link, point=point)[0][:3, 3] for end in ends]
            np.testing.assert_allclose(found[:, servo], (places[1] - places[0]) / (2 * step), atol=1e-7)


def test_an_arm_does_not_wait_for_fingers_on_its_board() -> None:
    """A motion of the elbow takes equally long with and without a simultaneous motion of the fingers."""
    robot = load_robot("icub")

    def duration(others: bool) -> int:
        gate, angles = Gate(robot, period=0.01, stale_after=0.05), np.array(initial_position(robot))
        servos = [12, *(range(16, 25) if others else ())]
        values = [angles[12] + 0.2, *([1.4] * 9 if others else ())]
        order = PlatformCommand(
            Mode.POSITION, np.array(servos), np.array(values), np.full(len(servos), np.inf)
        )
        for step in range(400):
            reading = JointReading(step * 0.01, step, angles.copy(), np.zeros(len(angles)))
            safe = gate.step([order] if step == 0 else [], reading, step * 0.01)
            angles[safe.servos] = safe.position
            if abs(angles[12] - values[0]) < 1e-6:
                return step
        raise AssertionError("it never came there")

    assert robot.servos[12].name == "l_elbow"
    assert duration(others=True) <= duration(others=False) + 1


def copy_folder(robot: str, to: Path) -> None:
    """Copies the files of a robot's description."""
    shutil.copytree(Path(load_robot(robot).source).parent, to, dirs_exist_ok=True)


def test_a_variant_has_all_of_what_it_extends_and_its_own(tmp_path: Path) -> None:
    plain, hands = load_robot("nao"), load_robot("nao-hands")
    assert [s.limits for s in hands.servos] == [s.limits for s in plain.servos]
    assert [s.name for s in hands.servos if s.mimics] == ["LHand", "RHand"]
    assert {p.name for p in plain.patches} < {p.name for p in hands.patches}
    assert hands.bindings == plain.bindings
    assert hands.digest != plain.digest
    copy_folder("nao", tmp_path)
    before = read_robot(tmp_path / "hands.xml").digest
    base = tmp_path / "robot.xml"
    base.write_text(base.read_text().replace('max="473.7"', 'max="400"'))
    changed = read_robot(tmp_path / "hands.xml")
    assert changed.digest != before
    assert changed.servos[0].limits.velocity == pytest.approx(np.deg2rad(400.0))


def test_a_fault_in_what_a_variant_changes_is_on_a_line_of_the_variant(tmp_path: Path) -> None:
    copy_folder("nao", tmp_path)
    variant = tmp_path / "v.xml"
    variant.write_text(
        '<generic_robot extends="robot.xml" name="narrow">\n<robot_part name="LArm">\n'
        '<servo id="3" nme="x"/>\n</robot_part>\n</generic_robot>'
    )
    with pytest.raises(DescriptionError, match=r"line 3: unknown attribute 'nme'"):
        read_robot(variant)


def test_an_address_may_name_the_topic_of_the_imu(tmp_path: Path) -> None:
    copy_folder("g1-bare", tmp_path)
    variant = tmp_path / "v.xml"
    variant.write_text(
        '<generic_robot extends="bare.xml" name="mine">'
        '<binding middleware="ros2" rate="100" stale_after="0.1">'
        '<address of="imu" to="/waist/imu"/></binding></generic_robot>'
    )
    assert read_robot(variant).binding("ros2").address("imu", "imu/data") == "/waist/imu"


def test_a_variant_removes_elements_and_keeps_the_rest() -> None:
    plain, bare = load_robot("g1"), load_robot("g1-bare")
    assert [p.surface for p in bare.patches] == [p.surface for p in plain.patches]
    assert not bare.skin
    assert bare.bindings == plain.bindings
    names = [s.name for s in load_robot("nao").servos]
    for gone in ("LWristYaw", "LHand", "RWristYaw", "RHand"):
        names.remove(gone)
    assert [s.name for s in load_robot("nao-h21").servos] == names


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('extends="robot.xml"', 'extends="nowhere.xml"', "valid: a description beside this one"),
        ('extends="robot.xml"', 'extends="hands.xml"', "valid: at most 6"),
        ('joint="LThumbFlexion"', 'joint="LThumb"', "the model has no moving joint 'LThumb'"),
        ('joint="LThumbFlexion"', 'joint="LIndexFlexion"', "second servo with joint 'LIndexFlexion'"),
        ('segment="palm"', 'segment="wrist"', "'left_fingers' has no segment 'wrist'"),
        ('<segment name="thumb"', '<segment name="toe"', "no segment of fingers is named 'toe'"),
        ('<segment name="thumb"', '<segment name="toe" removed="yes"', "<segment> removes nothing"),
    ],
)  # fmt: skip
def test_each_fault_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    folder = Path(load_robot("nao").source).parent
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    file = tmp_path / "hands.xml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(DescriptionError) as caught:
        read_robot(file)
    assert words in str(caught.value)
