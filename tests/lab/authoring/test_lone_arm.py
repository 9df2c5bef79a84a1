"""`propose` for one arm alone, on a table, a wall or a ceiling. The judge places the arm by its own
formulas."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import get_args

import mujoco
import numpy as np
import pytest

import tci
from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.lab.experiments.verdict import judge
from tci.messages import JointReading
from tci.messages.frames import Array
from tci.robot.description import Mount, Robot
from tci.robot.generic_arm import Side
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.skin.skin import Skin

UPPER, FORE = 0.3, 0.25


class Ask(tci.Capability[bool]):
    """Gives one command."""

    def __init__(self, command: tci.GenericCommand) -> None:
        self.command = command

    def init(self, body: tci.GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[tci.GenericCommand, ...], bool]:
        return () if memory else (self.command,), True


PAN, LIFT, ELBOW = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)


def made(
    folder: Path, *, turns: bool, lift: tuple[float, float, float] = LIFT, hangs: bool = False,
    bent: float = 0.0, hand: float = 0.1,
) -> Path:  # fmt: skip
    """An arm that stands upright at zero, or hangs from its base; with `turns`, its upper arm turns about its
    length. Its elbow is `bent` [m] beside the tube of the upper arm, as in arms of the shape of an L. Its
    last tube is `hand` [m] long."""
    pan, height = ("3.14159265358979 0 0", -0.1) if hangs else ("0 0 0", 0.1)
    joints = [("pan", "base", f"0 0 {height}", PAN), ("lift", "pan", "0 0 0.05", lift)]
    joints += [("turn", "lift", "0 0 0.1", (0.0, 0.0, 1.0))] if turns else []
    joints.append(("elbow", joints[-1][0], f"{bent} 0 {UPPER - 0.1 * turns}", ELBOW))
    joints.append(("wrist", "elbow", f"0 0 {FORE}", ELBOW))
    size = {"lift": UPPER, "turn": UPPER - 0.1, "elbow": FORE, "wrist": hand}
    text = "<robot name='arm'><link name='base'/>"
    for name, parent, xyz, axis in joints:
        long = size.get(name, 0.05)
        shape = f"<geometry><cylinder radius='0.03' length='{long}'/></geometry>"
        text += (
            f"<link name='{name}'><inertial><origin xyz='0 0 {long / 2}'/><mass value='1'/>"
            f"<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial>"
            f"<collision><origin xyz='0 0 {long / 2}'/>{shape}</collision></link>"
            f"<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{name}'/>"
            f"<origin xyz='{xyz}' rpy='{pan if name == 'pan' else '0 0 0'}'/>"
            f"<axis xyz='{' '.join(map(str, axis))}'/>"
            "<limit lower='-2.5' upper='2.5' effort='60' velocity='2'/></joint>"
        )
    path = folder / "arm.urdf"
    path.write_text(text + "</robot>")
    return path


def wrist(robot: Robot, side: Side, posture: Array) -> Array:
    """Place (3,) [m] of the wrist from the shoulder, in the torso frame, at generic angles [rad]."""
    joints, position = joint_map(robot, f"{side}_arm"), np.array(initial_position(robot))
    position[joints.servos] = joints.to_robot(posture, position)
    poses = KinematicChain(robot).poses(position, ["lift", "wrist"])
    return np.array(poses["wrist"][:3, 3] - poses["lift"][:3, 3])


@pytest.mark.parametrize(
    ("side", "mount", "turns"), [*product(("left", "right"), ("table", "wall", "ceiling"), (True, False))]
)
def test_pitch_turns_the_arm_and_roll_lifts_it(side: Side, mount: Mount, turns: bool, tmp_path: Path) -> None:
    """Outward is away from what the arm is mounted on: up, forward or down. At zero, it stretches ahead."""
    robot = propose(made(tmp_path, turns=turns), name="arm", side=side, mount=mount)
    x, z = np.eye(3)[0], np.eye(3)[2]
    outward, ahead = {"table": (z, x), "wall": (x, z), "ceiling": (-z, x)}[mount]
    inward = np.cross(ahead, outward) * (1.0 if side == "left" else -1.0)
    for pitch, roll, flexion in np.deg2rad([[0, 0, 0], [30, 0, 0], [0, 50, 0], [-40, 20, 0], [20, 60, 80]]):
        level = np.cos(pitch) * ahead + np.sin(pitch) * inward
        upper = np.cos(roll) * level + np.sin(roll) * outward
        fore = np.cos(roll - flexion) * level + np.sin(roll - flexion) * outward
        there = wrist(robot, side, np.array([pitch, roll, np.pi / 2.0, flexion, 0.0]))
        np.testing.assert_allclose(there, UPPER * upper + FORE * fore, atol=1e-9)
    lacks = [one.name for one in robot.part(f"{side}_arm").servos if one.servo is None]
    assert lacks == [*([] if turns else ["shoulder_yaw"]), "elbow_yaw"]


def test_no_motor_of_an_arm_is_too_weak_for_what_the_others_accelerate(tmp_path: Path) -> None:
    """As fetch's pan of 34 N m, of whose torque its elbow alone took 87 %: no acceleration takes more than
    about a third of a motor that carries it."""
    path, found = made(tmp_path, turns=True), {}
    text = path.read_text()
    for effort in (60.0, 12.0):
        path.write_text(text.replace("effort='60'", f"effort='{effort}'", 1))
        robot = propose(path, name="arm")
        found[effort] = np.array([one.limits.acceleration for one in robot.servos])
    model = mujoco.MjModel.from_xml_path(str(path))
    data, inertia, rng = mujoco.MjData(model), np.zeros((model.nv, model.nv)), np.random.default_rng(1)
    taken = np.zeros(model.nv)
    for _ in range(400):
        data.qpos[:] = rng.uniform(-1.5, 1.5, model.nq)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        taken = np.maximum(taken, np.abs(inertia[0]) / 12.0)
    assert (taken * found[12.0]).max() < 0.4
    assert (taken * found[60.0])[1:].max() > 0.5, "as they are with a strong pan"


@pytest.mark.parametrize("mount", get_args(Mount))
def test_an_arm_begins_where_it_can_withdraw_from_its_table(mount: Mount, tmp_path: Path) -> None:
    """The table is 0.15 m below the shoulder, and the last tube is 0.3 m long, with a radius of 30 mm: raised
    by 45 degrees with its elbow at 75 it would hit it by a withdrawal of 15 degrees."""
    robot = propose(made(tmp_path, turns=False, hand=0.3), name="arm", mount=mount)
    begun = robot.part("left_arm").initial_posture
    assert begun[1] < np.deg2rad(61.0), "the pan moves it aside"
    for roll, elbow in np.deg2rad([[0, 0], [-15, 0], [15, 0], [0, -15], [0, 15]]):
        lift, fore = begun[1] + roll, begun[1] + roll - begun[3] - elbow
        tip = 0.15 + UPPER * np.sin(lift) + (FORE + 0.3) * np.sin(fore) - 0.03 * np.cos(fore)
        assert tip > 0.005


def test_what_is_proposed_can_be_simulated_and_proved(tmp_path: Path) -> None:
    verdict = judge(propose(made(tmp_path, turns=False), name="arm"))
    assert not verdict.missing
    assert not verdict.faults
    assert [axes.part for axes in verdict.axes] == ["left_arm"]


def test_skin_of_an_arm_of_the_shape_of_an_l_faces_away_from_its_own_axis(tmp_path: Path) -> None:
    """Else a touch from below counts as one from the side, and the reflex goes the wrong way: each angle on
    the generic limb is that of the taxel's normal about the line from shoulder to elbow."""
    robot = propose(made(tmp_path, turns=False, bent=0.1), name="arm")
    skin, position = Skin(robot), np.array(initial_position(robot))
    joints = JointReading(0.0, 0, position, np.zeros_like(position))
    poses = KinematicChain(robot).poses(position, ["lift", "elbow"])
    line = poses["elbow"][:3, 3] - poses["lift"][:3, 3]
    normals = skin.surfaces["left_upper_arm"].normals @ poses["lift"][:3, :3].T
    across = np.cross(line, [0.0, 1.0, 0.0])
    along = np.cross(across, line)
    facing = np.arctan2(
        normals @ (along / np.linalg.norm(along)), normals @ (across / np.linalg.norm(across))
    )
    theta = skin.limb("left_upper_arm", joints)[1]
    alike = [abs(np.exp(1j * (theta + sign * facing)).mean()) for sign in (1.0, -1.0)]
    assert max(alike) > 0.99


OUTWARD = {"table": (0.0, 0.0, 1.0), "wall": (1.0, 0.0, 0.0), "ceiling": (0.0, 0.0, -1.0)}


@pytest.mark.parametrize("mount", get_args(Mount))
def test_the_gate_keeps_an_arm_from_what_carries_it(mount: Mount, tmp_path: Path) -> None:
    """The base has no shapes, so the surface is at its origin; the last link is a tube of 0.1 m with a radius
    of 30 mm."""
    robot = propose(made(tmp_path, turns=False), name="arm", mount=mount)
    down = np.deg2rad([0.0, -60.0, 0.0, 0.0, 0.0])
    with tci.connect(robot, "sim") as driver:
        result = tci.run(driver, Ask(tci.GenericCommand("left_arm", "position", down)), duration=1.6)
        position = driver.read().joints.position
    assert f"near {mount}; valid: at least 5 mm" in str(result)
    poses = KinematicChain(robot).poses(position, ["base", "wrist"])
    along = poses["wrist"][:3, 2] @ OUTWARD[mount]
    tip = (poses["wrist"][:3, 3] - poses["base"][:3, 3]) @ OUTWARD[mount] + 0.1 * along
    assert 0.004 < tip - 0.03 * np.sqrt(1.0 - along**2) < 0.015  # the lowest point of the last tube


def test_an_arm_on_a_cart_stands_on_nothing_flat(tmp_path: Path) -> None:
    path = made(tmp_path, turns=False)
    text = path.read_text().replace("<robot name='arm'>", "<robot name='arm'><link name='cart'/>")
    inertia = "<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/>"
    wheel = (
        "<joint name='fixed' type='fixed'><parent link='cart'/><child link='base'/></joint>"
        f"<link name='tyre'><inertial><mass value='1'/>{inertia}</inertial></link>"
        "<joint name='wheel' type='continuous'><parent link='cart'/>"
        "<child link='tyre'/><axis xyz='0 1 0'/><limit effort='10' velocity='5'/></joint></robot>"
    )
    path.write_text(text.replace("</robot>", wheel))
    for mount in (None, "table"):
        robot = propose(path, name="arm", mount=mount)
        assert robot.model.stands_on is None
        assert [part.name for part in robot.parts if part.kind == "arm"] == ["left_arm"]


def test_an_arm_that_hangs_in_its_model_is_on_a_ceiling_and_forward_is_by_choice(tmp_path: Path) -> None:
    path = made(tmp_path, turns=True, hangs=True)
    robot = propose(path, name="arm", forward="-y")
    there = KinematicChain(robot).poses(initial_position(robot), ["wrist"])["wrist"][:3, 3]
    assert there[2] < -0.1
    np.testing.assert_allclose(robot.model.T_LT[:3, 0], [0.0, -1.0, 0.0], atol=1e-9)
    with pytest.raises(DescriptionError, match="--forward z is along the pan's axis; valid: x, y, -x, -y"):
        propose(path, name="arm", forward="z")


def test_a_lift_that_is_not_square_is_refused_with_what_is_valid(tmp_path: Path) -> None:
    slanted = made(tmp_path, turns=False, lift=(0.0, 0.9, 0.43589))
    with pytest.raises(DescriptionError, match=r"no single arm that a pan turns.*lift is square to its pan"):
        propose(slanted, name="arm")
    turned = made(tmp_path, turns=True, lift=(0.0, 0.99, 0.141067))
    with pytest.raises(DescriptionError, match="at turn is carried by lift, not parallel"):
        propose(turned, name="arm")


def pair(folder: Path, *, carried: bool) -> Path:
    """Two such arms beside each other; with `carried`, their shoulders have the order roll, yaw, pitch."""
    path = made(folder, turns=False)
    head, arm = path.read_text().removesuffix("</robot>").split("<link name='base'/>")
    head += "<link name='base'/>"
    for side, y in (("left", 0.4), ("right", -0.4)):
        own = re.sub("'(pan|lift|elbow|wrist)'", rf"'{side}_\1'", arm)
        if carried:
            own = own.replace("<parent link='base'/>", f"<parent link='{side}_roll'/>")
            own += (
                f"<link name='{side}_roll'><inertial><mass value='1'/>"
                "<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
                f"<joint name='{side}_roll' type='revolute'><parent link='base'/>"
                f"<child link='{side}_roll'/><origin xyz='0 {y} 0'/><axis xyz='1 0 0'/>"
                "<limit lower='-2' upper='2' effort='60' velocity='2'/></joint>"
            )
        else:
            own = own.replace("<origin xyz='0 0 0.1' rpy='0 0 0'/>", f"<origin xyz='0 {y} 0.1'/>")
        head += own
    path.write_text(head + "</robot>")
    return path


def test_two_arms_of_other_shoulders_are_refused_with_advice_that_works(tmp_path: Path) -> None:
    path = pair(tmp_path, carried=False)
    with pytest.raises(DescriptionError, match=r"two limbs, at left_pan and right_pan.*: --arms with one"):
        propose(path, name="arms")
    robot = propose(path, name="arms", arms=("right_pan",), side="right")
    (arm,) = (part for part in robot.parts if part.kind == "arm")
    moved = [robot.servos[one.servo].joint for one in arm.servos if one.servo is not None]
    assert moved == ["right_pan", "right_lift", "right_elbow"]
    assert robot.model.stands_on is None
    path = pair(tmp_path, carried=True)
    order = r"left_roll, left_pan, left_lift and right_roll, right_pan, right_lift: neither.*valid: a robot"
    with pytest.raises(DescriptionError, match=order):
        propose(path, name="arms")
    with pytest.raises(DescriptionError, match="at left_pan is carried by left_roll, not parallel"):
        propose(path, name="arms", arms=("left_pan",))


def test_one_of_two_arms_that_lean_on_a_waist_is_taken(tmp_path: Path) -> None:
    """As Nextage's: its waist turns about the vertical, and its pans lean to the sides by 15 degrees."""
    path = pair(tmp_path, carried=False)
    text = path.read_text()
    for y, lean in ((0.4, -0.2618), (-0.4, 0.2618)):
        text = text.replace(
            f"<origin xyz='0 {y} 0.1' rpy='0 0 0'/>", f"<origin xyz='0 {y} 0.1' rpy='{lean} 0 0'/>"
        )
    waist = (
        "<link name='floor'/><joint name='waist' type='revolute'><parent link='floor'/><child link='base'/>"
        "<axis xyz='0 0 1'/><limit lower='-2' upper='2' effort='60' velocity='2'/></joint></robot>"
    )
    inertia = "<inertia ixx='0.1' iyy='0.1' izz='0.1' ixy='0' ixz='0' iyz='0'/>"
    text = text.replace(
        "<link name='base'/>", f"<link name='base'><inertial><mass value='5'/>{inertia}</inertial></link>"
    )
    path.write_text(text.replace("</robot>", waist))
    robot = propose(path, name="arms", arms=("left_pan",))
    (arm,) = (part for part in robot.parts if part.kind == "arm")
    moved = [robot.servos[one.servo].joint for one in arm.servos if one.servo is not None]
    assert moved == ["left_pan", "left_lift", "left_elbow"]
    assert robot.model.torso_link == "base"
    assert not judge(robot).faults
