"""What `tci new-robot` advises of a gripper or hand that it refuses works, followed by a program."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot

JAW = """<mujoco>
<worldbody><body name="base"><geom name="a" type="box" size="0.04 0.06 0.02" mass="0.4"/>
<geom name="a" type="box" size="0.01 0.01 0.01" mass="0.4"/>
<body name="jaw" pos="0 0.03 0.02"><joint name="swings" axis="1 0 0" range="-0.1 0.9"/>
<geom type="box" size="0.01 0.005 0.03" pos="0 0.005 0.03" mass="0.05"/></body>
</body></worldbody></mujoco>"""


def three_fingers() -> str:
    """Fingers that are bent at the model's zero, and whose outer joint turns against the inner one."""
    fingers = "".join(
        f'<body name="{name}" pos="{x} {y} 0.02" euler="0 0 {turn}">'
        f'<joint name="{name}_inner" axis="-1 0 0" range="0 1.5"/>'
        '<geom type="capsule" size="0.006" fromto="0 0 0 0 0 0.04" mass="0.02"/>'
        f'<body name="{name}_outer" pos="0 0 0.04"><joint name="{name}_outer" axis="1 0 0" range="0 2"/>'
        '<geom type="capsule" size="0.006" fromto="0 0 0 0 0 0.04" mass="0.02"/></body></body>'
        for name, x, y, turn in (
            ("thumb", 0, -0.03, 180),
            ("index", 0.02, 0.03, 0),
            ("little", -0.02, 0.03, 0),
        )
    )
    return (
        '<mujoco><worldbody><body name="palm"><geom type="box" size="0.04 0.04 0.02" mass="0.4"/>'
        f"{fingers}</body></worldbody></mujoco>"
    )


def taken(file: Path) -> tuple[Robot, list[str]]:
    """The robot, and the advice that a program followed until it was taken."""
    followed: list[str] = []
    while len(followed) < 4:
        try:
            return propose(file, name="hand", side="right"), followed
        except DescriptionError as error:
            said, text = str(error), file.read_text()
        if line := re.search(r"line (\d+); valid: .*remove the element in that line", said):
            lines = text.splitlines()
            del lines[int(line[1]) - 1]
            text = "\n".join(lines)
            followed.append("removed")
        elif '<compiler angle="radian"/>' in said:
            assert re.search("swings|thumb_inner, thumb_outer", said), said  # it names the joints
            text = text.replace("<mujoco>", '<mujoco><compiler angle="radian"/>')
            text = text.replace('euler="0 0 180"', f'euler="0 0 {np.pi}"')
            followed.append("radian")
        file.write_text(text)
    pytest.fail(f"not taken after {followed}")


def test_a_repeated_name_and_radians_read_as_degrees_are_mended_by_the_advice(tmp_path: Path) -> None:
    file = tmp_path / "jaw.xml"
    file.write_text(JAW)
    robot, followed = taken(file)
    assert followed == ["removed", "radian"]
    (servo,) = robot.servos
    assert (servo.limits.lower, servo.limits.upper) == pytest.approx((-0.1, 0.9))


def test_fingers_whose_inner_joint_is_bent_at_zero_bend_by_the_outer_one(tmp_path: Path) -> None:
    file = tmp_path / "hand.xml"
    file.write_text(three_fingers())
    robot, followed = taken(file)
    assert followed == ["radian"]
    model = mujoco.MjModel.from_xml_path(str(file))
    for servo in robot.servos:
        ends = model.joint(servo.joint).range
        assert (servo.limits.lower, servo.limits.upper) == pytest.approx(ends)
    maps, chain, part = joint_map(robot, "right_fingers"), KinematicChain(robot), robot.part("right_fingers")
    tips = []
    for flexion in (0.0, 0.5, 1.0):
        generic, position = np.array(part.initial_posture), np.zeros(len(robot.servos))
        generic[[one.id for one in part.servos if one.name.endswith("_flexion")]] = flexion
        position[maps.servos] = maps.to_robot(generic, position)
        for servo in robot.servos:
            assert servo.limits.lower <= position[servo.index] <= servo.limits.upper
        poses = chain.poses(position, ["palm", "thumb_outer", "index_outer", "little_outer"])
        base = np.linalg.inv(poses["palm"])
        tips.append([(base @ poses[name] @ [0.0, 0.0, 0.04, 1.0])[:3] for name in list(poses)[1:]])
    inward = np.array([1.0, -1.0, -1.0])  # along y
    assert (np.diff(np.array(tips)[:, :, 1], axis=0) * inward > 0.005).all()


def test_the_option_for_radians_takes_the_file_as_it_is(tmp_path: Path) -> None:
    """Judged by MuJoCo, in a scene in radians that includes the file."""
    file = tmp_path / "hand.xml"
    file.write_text(three_fingers().replace('euler="0 0 180"', f'euler="0 0 {np.pi}"'))
    with pytest.raises(DescriptionError, match="--radians"):
        propose(file, name="hand", side="right")
    target = tmp_path / "robot.xml"
    target.write_text(write_robot(propose(file, name="hand", side="right", radians=True), file=file.name))
    robot = read_robot(target)
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco><compiler angle="radian"/><include file="hand.xml"/></mujoco>')
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    position = np.array([0.4 + 0.1 * servo.index for servo in robot.servos])
    for servo in robot.servos:
        assert (servo.limits.lower, servo.limits.upper) == pytest.approx(model.joint(servo.joint).range)
        data.joint(servo.joint).qpos = position[servo.index]
    mujoco.mj_kinematics(model, data)
    poses = KinematicChain(robot).poses(position, ["palm", "thumb_outer"])
    place = (np.linalg.inv(poses["palm"]) @ poses["thumb_outer"])[:3, 3]
    palm = data.body("palm")
    apart = palm.xmat.reshape(3, 3).T @ (data.body("thumb_outer").xpos - palm.xpos)
    assert place == pytest.approx(apart, abs=1e-9)
