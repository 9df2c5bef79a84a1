"""Retargeting of shoulders, for a made robot whose servos are the generic joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers import small_robot
from tci.errors import DescriptionError
from tci.robot.description import GenericServo, Robot, Segment, Term
from tci.robot.joint_map import joint_map

POSITION = np.random.default_rng(0).uniform(-0.5, 0.5, 10)
ELBOWS = [
    {"scale": -1.0},
    {"transform": "table", "table": ((-2.0, 2.0), (2.0, -2.0))},
    {"transform": "coupled", "terms": (Term(servo=3, factor=-1.0),)},
]
"""Descriptions of an elbow that flexes when the angle of its servo decreases."""


def retargeted(tmp_path: Path, *, elbow: dict[str, object], forearm: tuple[float, float, float]) -> Robot:
    robot = small_robot.build(tmp_path)
    arm = robot.parts[0]
    joints: list[GenericServo] = [one.model_copy(update={"transform": "retarget"}) for one in arm.servos[:3]]
    joints.append(arm.servos[3].model_copy(update=elbow))
    segments = (
        arm.segments[0],
        Segment(name="forearm", link="l_3", origin=forearm, length=small_robot.LOWER),
    )
    part = arm.model_copy(update={"servos": (*joints, arm.servos[4]), "segments": segments})
    return robot.model_copy(update={"parts": (part,), "digest": str(tmp_path)})


@pytest.mark.parametrize("elbow", ELBOWS, ids=lambda elbow: str(elbow.get("transform")))
def test_which_way_the_elbow_flexes_is_taken_from_its_transform(
    tmp_path: Path, elbow: dict[str, object]
) -> None:
    """The elbow of the small robot bends backward when its angle decreases, because the upper arm is rotated
    by half a turn."""
    robot = retargeted(tmp_path, elbow=elbow, forearm=(0.0, 0.0, 0.0))
    generic = joint_map(robot, "left_arm").to_generic(POSITION)
    expected = [*POSITION[:2], POSITION[2] + np.pi, -POSITION[3], POSITION[4]]
    np.testing.assert_allclose(np.exp(1j * generic), np.exp(1j * np.array(expected)), rtol=0, atol=1e-9)


def test_what_no_shoulder_can_be_built_from_is_told(tmp_path: Path) -> None:
    robot = retargeted(tmp_path, elbow={}, forearm=(0.0, 0.0, small_robot.UPPER))
    with pytest.raises(
        DescriptionError, match="left_arm has no shoulder of the generic arm: its upper_arm and forearm begin"
    ):
        joint_map(robot, "left_arm")
    assert robot.model is not None
    path = Path(robot.model.path)
    path.write_text(
        path.read_text().replace("<joint name='l1' axis='1 0 0'/>", "<joint name='l1' axis='0 1 0'/>")
    )
    with pytest.raises(DescriptionError, match="two of its successive axes are parallel"):
        joint_map(robot.model_copy(update={"digest": "parallel"}), "left_arm")
