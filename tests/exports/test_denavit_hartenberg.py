"""DH tables agree with the model from which they are computed, and with published tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers import small_robot
from helpers.moving import ENDS, random_postures, robot_and_kinematics
from tci.errors import CommandError, UnknownNameError
from tci.exports.denavit_hartenberg import Convention, denavit_hartenberg
from tci.robot.description import Model, Robot, Servo
from tci.robot.kinematics import KinematicChain


@pytest.mark.parametrize("convention", ["classic", "modified"])
@pytest.mark.parametrize(("name", "link"), ENDS)
def test_the_table_reproduces_forward_kinematics(name: str, link: str, convention: Convention) -> None:
    robot, kinematics = robot_and_kinematics(name)
    table = denavit_hartenberg(kinematics, link, convention=convention)
    for posture in random_postures(robot, 1000):
        T_TL = kinematics.poses(posture, [link])[link]
        assert np.abs(table.pose(posture) - T_TL).max() < 1e-9


def test_naos_arm_has_the_published_lengths() -> None:
    """Craig's parameters of NAO's left arm are a = 15 mm, d = 105 mm and 55.95 mm, with multiples of 90
    degrees as twists."""
    _, kinematics = robot_and_kinematics("nao")
    table = denavit_hartenberg(kinematics, "LHand", convention="modified")
    assert np.allclose(np.abs(table.a), [0, 0, 0.015, 0, 0], atol=1e-12)
    assert np.allclose(np.abs(np.degrees(table.alpha)), [0, 90, 90, 90, 90])
    assert np.allclose(table.d, [0, 0, 0.105, 0, 0], atol=1e-12)
    assert table.tool[:3, 3] @ table.tool[:3, 3] == pytest.approx(0.05595**2)
    assert np.allclose(table.base[:3, 3], [0, 0.098, 0.1])


def test_both_conventions_share_base_and_tool() -> None:
    _, kinematics = robot_and_kinematics("icub")
    classic = denavit_hartenberg(kinematics, "l_hand")
    modified = denavit_hartenberg(kinematics, "l_hand", convention="modified")
    assert np.array_equal(classic.base, modified.base)
    assert np.array_equal(classic.tool, modified.tool)
    assert np.array_equal(classic.a[:-1], modified.a[1:])


@pytest.mark.parametrize("convention", ["classic", "modified"])
def test_random_parallel_and_coincident_axes(tmp_path: Path, convention: Convention) -> None:
    """The axes are skew, parallel (twice), coincident in both directions, intersecting, and skew."""
    axes = ["0.3 -0.5 0.8", "0 1 0", "0 1 0", "0 -1 0", "0 -1 0", "1 0 0", "0.1 0.9 -0.4"]
    places = ["0.1 0.2 0.3", "0.1 0 0.2", "0.2 0.3 0", "0.1 0.1 0", "0 0.2 0", "0 0 0", "0.1 0.1 0.2"]
    text = ""
    for i in reversed(range(7)):
        joint = f"<joint name='j{i}' axis='{axes[i]}'/>"
        text = f"<body name='b{i}' pos='{places[i]}'>{joint}<geom size='0.01'/>{text}</body>"
    path = tmp_path / "chain.xml"
    path.write_text(f"<mujoco><worldbody><body name='torso'>{text}</body></worldbody></mujoco>")
    robot = Robot(
        name="chain",
        source="chain",
        digest="0" * 64,
        model=Model(format="mjcf", path=str(path), torso_link="torso", torso_rpy=(0.1, 0.2, 0.3)),
        servos=tuple(Servo(index=i, robot_part="arm", id=i, name=f"j{i}", joint=f"j{i}") for i in range(7)),
        parts=(),
    )
    kinematics = KinematicChain(robot)
    for link in [f"b{i}" for i in range(7)]:
        table = denavit_hartenberg(kinematics, link, convention=convention)
        for posture in random_postures(robot, 20):
            T_TL = kinematics.poses(posture, [link])[link]
            assert np.abs(table.pose(posture) - T_TL).max() < 1e-9
        assert np.abs(table.d).max() < 10.0


def test_what_has_no_table_says_so(tmp_path: Path) -> None:
    kinematics = KinematicChain(small_robot.build(tmp_path))
    with pytest.raises(CommandError, match="no servo moves 'torso'"):
        denavit_hartenberg(kinematics, "torso")
    with pytest.raises(CommandError, match="valid: classic, modified"):
        denavit_hartenberg(kinematics, "l_4", convention="modern")
    with pytest.raises(UnknownNameError, match="l_9"):
        denavit_hartenberg(kinematics, "l_9")
