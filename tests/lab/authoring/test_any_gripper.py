"""Grippers whose jaws slide or swing are proposed as a thumb and an index finger, or refused by a joint."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import tci
from tci.capabilities import FingerReflex, LightGrasp
from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot
from tci.runtime.loop import Tick

GRIPPER = """<mujoco><compiler angle="radian"/>
<worldbody><body name="base"><geom type="box" size="0.04 0.06 0.02" mass="0.4"/>
  <body name="left" pos="0 0.002 0.02">{left}<geom type="box" size="0.01 0.005 0.03" pos="0 0.005 0.03"
    mass="0.05"/>{tip}</body>
  <body name="right" pos="0 -0.002 0.02">{right}<geom type="box" size="0.01 0.005 0.03" pos="0 -0.005 0.03"
    mass="0.05"/></body>
</body></worldbody>{more}</mujoco>"""
SLIDES = {
    "left": '<joint name="l" type="slide" axis="0 1 0" range="0 0.04"/>',
    "right": '<joint name="r" type="slide" axis="0 -1 0" range="0 0.04"/>', "tip": "",
    "more": '<equality><joint joint1="r" joint2="l" polycoef="0.003 0.9 0 0 0"/></equality>',
}  # fmt: skip
SWINGS = {
    "left": '<joint name="l" axis="1 0 0" range="-0.6 0.1"/>',
    "right": '<joint name="r" axis="1 0 0" range="-0.1 0.6"/>', "tip": "", "more": "",
}  # fmt: skip


def proposed(folder: Path, **parts: str) -> tuple[Robot, Path]:
    """The gripper as `tci check` reads it, and its model."""
    model = folder / "gripper.xml"
    model.write_text(GRIPPER.format(**parts))
    target = folder / "robot.xml"
    target.write_text(write_robot(propose(model, name="gripper", side="right"), file=model.name))
    return read_robot(target), model


@pytest.mark.parametrize("kind", ["slides", "swings"])
def test_the_jaws_close_together_and_stand_where_mujoco_puts_them(tmp_path: Path, kind: str) -> None:
    robot, file = proposed(tmp_path, **(SLIDES if kind == "slides" else SWINGS))
    model = mujoco.MjModel.from_xml_path(str(file))
    data, chain, maps = mujoco.MjData(model), KinematicChain(robot), joint_map(robot, "right_fingers")
    assert [one.name for one in robot.part("right_fingers").servos if one.servo is not None] == [
        "thumb_flexion", "index_flexion",
    ]  # fmt: skip
    assert len(robot.servos) == (1 if kind == "slides" else 2)
    gaps = []
    for flexion in np.linspace(0.0, 1.0 if kind == "slides" else 0.7, 6):
        generic, position = np.zeros(10), np.zeros(len(robot.servos))
        generic[[1, 3]] = flexion
        position[maps.servos] = maps.to_robot(generic, position)
        for servo in robot.servos:
            for one in servo.joints:
                place = model.joint(one.joint).qposadr[0]
                data.qpos[place] = one.multiplier * position[servo.index] + one.offset
        if kind == "slides":
            assert data.qpos[1] == pytest.approx(0.003 + 0.9 * data.qpos[0], abs=1e-9)
        mujoco.mj_kinematics(model, data)
        poses = chain.poses(position, ["base", "left", "right"])
        for name in ("left", "right"):
            T_BL = np.linalg.inv(poses["base"]) @ poses[name]
            R_WB = data.body("base").xmat.reshape(3, 3)
            assert T_BL[:3, 3] == pytest.approx(
                R_WB.T @ (data.body(name).xpos - data.body("base").xpos), abs=1e-9
            )
            assert T_BL[:3, :3] == pytest.approx(R_WB.T @ data.body(name).xmat.reshape(3, 3), abs=1e-9)
        tips = [
            data.body(name).xpos + data.body(name).xmat.reshape(3, 3) @ [0.0, 0.0, 0.06]
            for name in ("left", "right")
        ]
        gaps.append(tips[0][1] - tips[1][1])
    assert (np.diff(gaps) < -0.005).all()  # open at 0, and closing


def test_a_sliding_jaw_has_the_limits_and_the_force_of_the_model(tmp_path: Path) -> None:
    acts = '<actuator><position joint="l" kp="100" forcelimited="true" forcerange="-30 30"/></actuator>'
    robot, _ = proposed(tmp_path, **SLIDES | {"more": SLIDES["more"] + acts})
    (servo,) = robot.servos
    slide = servo.joints[0]
    assert (slide.joint, slide.slides, servo.joint) == ("l", True, None)
    assert [slide.multiplier * end for end in (servo.limits.lower, servo.limits.upper)] == pytest.approx(
        [0.0, 0.04]
    )
    assert servo.limits.torque == pytest.approx(30.0 * slide.multiplier)
    with tci.connect(robot, "sim") as driver:
        model = driver.world.model
        assert model.actuator("l").forcerange == pytest.approx([-30.0, 30.0])
        assert model.joint("l").range == pytest.approx([0.0, 0.04])


def test_a_pressed_gripper_lets_go_and_a_touched_palm_closes_it(tmp_path: Path) -> None:
    robot, _ = proposed(tmp_path, **SLIDES)
    with tci.connect(robot, "sim") as driver:
        bent = []

        def see(tick: Tick) -> None:
            bent.append(float(tick.perception.posture["right_fingers"][3]))
            if len(bent) == round(1.5 / driver.period):
                driver.world.finger.poke("right_index_pad", 12)

        result = tci.run(driver, FingerReflex(), duration=2.0, observe=see)
    assert max(bent) == pytest.approx(np.deg2rad(3.0) + FingerReflex().curl, abs=0.02)  # it hangs
    assert bent[-1] < 0.1, result
    with tci.connect(robot, "sim") as driver:
        driver.world.finger.poke("right_palm", 12, depth=0.004)
        assert tci.run(driver, LightGrasp(), duration=0.8).moved


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"more": '<equality><connect body1="left" body2="right" anchor="0 0 0"/></equality>'},
            "l and r: an equality closes a loop of links.*valid: a model whose jaws follow",
        ),
        (
            {"left": '<joint name="l" axis="1 0 0" range="-0.01 0.001"/>'},
            'l: its range of -0.01 to 0.001 rad opens its jaw by 0.7 mm; valid: .*<compiler angle="radian"/>',
        ),
    ],
)  # fmt: skip
def test_a_gripper_in_doubt_is_refused_by_its_joint(
    tmp_path: Path, changed: dict[str, str], words: str
) -> None:
    with pytest.raises(DescriptionError, match=words):
        proposed(tmp_path, **SWINGS | changed)


def test_a_tip_with_a_motor_of_its_own_keeps_its_direction(tmp_path: Path) -> None:
    def tip(name: str, axis: int) -> str:
        return (
            f'<body name="{name}" pos="0 0 0.06"><joint name="{name}" axis="{axis} 0 0" range="-0.6 0.6"/>'
            '<geom type="box" size="0.01 0.005 0.01" pos="0 0.005 0.01" mass="0.02"/></body>'
        )

    parts = SWINGS | {"tip": tip("lt", 1)}
    parts["right"] += tip("rt", -1)
    robot, _ = proposed(tmp_path, **parts)
    maps, chain = joint_map(robot, "right_fingers"), KinematicChain(robot)
    turned = []
    for flexion in (0.1, 0.5):
        generic, position = np.zeros(10), np.zeros(len(robot.servos))
        position[maps.servos] = maps.to_robot(robot.part("right_fingers").initial_posture, position)
        generic[[1, 3]] = flexion
        position[maps.servos] = maps.to_robot(generic, position)
        turned.append([pose[:3, :3] for pose in chain.poses(position, ["lt", "rt"]).values()])
    assert np.array(turned[0]) == pytest.approx(np.array(turned[1]), abs=1e-6)
