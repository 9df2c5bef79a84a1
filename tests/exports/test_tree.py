"""Exports for other programs: links, chains and URDF, for models with kinds of joints that no packaged robot
has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers.peers import needs_pinocchio
from tci.errors import DescriptionError
from tci.exports.chain import ChainSegment, chain_to
from tci.exports.facts import query
from tci.exports.tree import links_of
from tci.exports.urdf import TORSO, to_urdf
from tci.messages.frames import invert, transform
from tci.robot.description import GenericPart, GenericServo, Limits, Model, Robot, Servo
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import turn

pinocchio = needs_pinocchio()

MJCF = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="torso" pos="1 2 3" euler="0.1 0.2 0.3"><joint name="waist" axis="0 1 0"/>
    <body name="arm" pos="0.1 0 0" quat="1 2 3 4">
      <joint name="one" axis="1 1 0" ref="0.7" {one}/>
      <joint name="two" axis="0 0 1"/>
      <joint name="lift" type="slide" axis="1 0 1" ref="0.2"/>
      <body name="hand" pos="0 0.2 0"><joint name="wrist" axis="0 1 0"/></body>
    </body>
  </body>
</worldbody></mujoco>
"""
JOINTS = ("waist", "one", "two", "lift", "wrist")


def described(tmp_path: Path, text: str, joints: tuple[str, ...] = JOINTS, *, limited: bool = True) -> Robot:
    path = tmp_path / "odd.xml"
    path.write_text(text)
    limits = Limits(lower=-1.0, upper=1.0) if limited else Limits()
    return Robot(
        name="odd",
        source="odd",
        digest="0" * 64,
        model=Model(
            format="mjcf", path=str(path), torso_link="torso", torso_rpy=(0.3, 0, 1), torso_xyz=(0, 0.1, 0)
        ),
        servos=tuple(
            Servo(index=i, robot_part="all", id=i, name=joint, joint=joint, limits=limits)
            for i, joint in enumerate(joints)
        ),
        parts=(
            GenericPart(
                name="all",
                kind="other",
                servos=tuple(GenericServo(id=i, name=joint, servo=i) for i, joint in enumerate(joints)),
            ),
        ),
    )


def postures(robot: Robot) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(robot.servos)))


def followed(segments: tuple[ChainSegment, ...], position: np.ndarray) -> np.ndarray:
    """Returns the pose (4, 4) of the end of a chain, with KDL's formula."""
    pose = np.eye(4)
    for segment in segments:
        if segment.servo is not None:
            angle, axis, origin = position[segment.servo], np.array(segment.axis), np.array(segment.origin)
            rotation = np.eye(3) if segment.slides else turn(axis, angle)
            pose = pose @ transform(rotation, angle * axis if segment.slides else origin - rotation @ origin)
        pose = pose @ np.array(segment.tip)
    return pose


def test_references_slides_and_several_joints_on_a_link(tmp_path: Path) -> None:
    robot = described(tmp_path, MJCF.format(one=""))
    kinematics = KinematicChain(robot)
    model = pinocchio.buildModelFromXML(to_urdf(robot))
    data = model.createData()
    assert sorted(model.names[1:]) == sorted(JOINTS)
    joints = [model.joints[model.getJointId(joint)].idx_q for joint in JOINTS]
    torso = model.getFrameId(TORSO)
    chains = {link: chain_to(robot, link) for link in kinematics.links}
    assert [segment.name for segment in chains["hand"]] == [
        "torso", "arm_one", "arm_two", "arm", "hand",
    ]  # fmt: skip
    for position in postures(robot):
        q = np.zeros(model.nq)
        q[joints] = position
        pinocchio.framesForwardKinematics(model, data, q)
        for link, expected in kinematics.poses(position, kinematics.links).items():
            found = (data.oMf[torso].inverse() * data.oMf[model.getFrameId(link)]).homogeneous
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
            np.testing.assert_allclose(followed(chains[link], position), expected, rtol=0, atol=1e-12)


def test_bodies_without_a_name_carry_others_too(tmp_path: Path) -> None:
    text = MJCF.format(one="").replace('<body name="arm"', "<body")
    robot = described(tmp_path, text)
    position = postures(robot)[0]
    expected = KinematicChain(robot).poses(position, ["hand"])["hand"]
    np.testing.assert_allclose(followed(chain_to(robot, "hand"), position), expected, rtol=0, atol=1e-12)
    assert "" not in [link.name for link in links_of(robot)]
    assert pinocchio.buildModelFromXML(to_urdf(robot)).njoints == 1 + len(JOINTS)


def test_a_chain_turns_about_axes_beside_their_links(tmp_path: Path) -> None:
    robot = described(tmp_path, MJCF.format(one='pos="0.01 0.02 0.03"'))
    kinematics, chain = KinematicChain(robot), chain_to(robot, "hand")
    for position in postures(robot):
        expected = kinematics.poses(position, ["hand"])["hand"]
        np.testing.assert_allclose(followed(chain, position), expected, rtol=0, atol=1e-12)
    with pytest.raises(DescriptionError, match="does not turn about its link's origin"):
        to_urdf(robot)


def test_a_joint_below_the_torso_is_in_the_urdf(tmp_path: Path) -> None:
    robot = described(tmp_path, MJCF.format(one=""))
    model = pinocchio.buildModelFromXML(to_urdf(robot))
    data = model.createData()
    q = np.zeros(model.nq)
    q[model.joints[model.getJointId("waist")].idx_q] = 0.5
    pinocchio.framesForwardKinematics(model, data, q)
    turned = data.oMf[model.getFrameId("torso")].homogeneous
    pinocchio.framesForwardKinematics(model, data, np.zeros(model.nq))
    before = data.oMf[model.getFrameId("torso")].homogeneous
    np.testing.assert_allclose(
        invert(before) @ turned, transform(turn(np.array([0.0, 1.0, 0.0]), 0.5), np.zeros(3)), atol=1e-12
    )


def test_facts_of_a_robot_whose_joint_slides_have_no_dh_table_of_it(tmp_path: Path) -> None:
    robot = described(tmp_path, MJCF.format(one=""))
    facts = query(robot)
    assert facts.denavit_hartenberg == ()
    assert [segment.slides for segment in facts.chains["all"]] == [False, False, False, True, False]


def test_a_slide_without_limits_is_in_no_urdf(tmp_path: Path) -> None:
    robot = described(tmp_path, MJCF.format(one=""), limited=False)
    assert links_of(robot)
    with pytest.raises(DescriptionError, match="the joint of arm slides and has no limits"):
        to_urdf(robot)


def test_a_ball_joint_is_no_servos(tmp_path: Path) -> None:
    text = MJCF.format(one="").replace('name="wrist" axis="0 1 0"', 'name="wrist" type="ball"')
    with pytest.raises(
        DescriptionError, match="servo wrist: the joint 'wrist' has several axes; valid: a hinge"
    ):
        KinematicChain(described(tmp_path, text))
