"""Retargeting of shoulders, for a made robot whose servos are the generic joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers import small_robot
from tci.errors import DescriptionError
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericServo, Robot, Segment, Term
from tci.robot.joint_map import joint_map
from tci.robot.shoulder import shoulder_of

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


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(one.T @ other) - 1.0) / 2.0, -1.0, 1.0)))


@pytest.mark.parametrize("name", ["talos", "g1", "alex"])
def test_only_what_the_limits_allow_is_asked_within_them(name: str) -> None:
    shoulder, chance, kept = shoulder_of(load_robot(name), "left_arm"), np.random.default_rng(0), 0
    for _ in range(300):
        near = chance.uniform(shoulder.lower, shoulder.upper)
        wanted = shoulder.rotation(chance.uniform(-np.pi, np.pi, 3))
        asked = shoulder.goal(wanted, near)
        if np.all(asked == np.clip(asked, shoulder.lower, shoulder.upper)):
            kept += 1
            assert apart(shoulder.rotation(asked), wanted) < 1e-6
    assert 20 < kept < 280


@pytest.mark.parametrize("name", ["talos", "g1", "alex"])
def test_beyond_the_limits_no_posture_nearby_is_nearer_to_what_is_wanted(name: str) -> None:
    shoulder, chance, ended = shoulder_of(load_robot(name), "left_arm"), np.random.default_rng(0), 0
    for _ in range(300):
        near = chance.uniform(shoulder.lower, shoulder.upper)
        wanted = shoulder.rotation(near + chance.uniform(-0.4, 0.4, 3))
        asked = shoulder.goal(wanted, near)
        angles = np.clip(asked, shoulder.lower, shoulder.upper)
        if not np.any(asked != angles) or abs(np.sin(angles[1])) < 0.1:
            continue
        ended += 1
        least = apart(shoulder.rotation(angles), wanted)
        for step in np.vstack([0.02 * np.eye(3), -0.02 * np.eye(3)]):
            beside = np.clip(angles + step, shoulder.lower, shoulder.upper)
            assert apart(shoulder.rotation(beside), wanted) > least - 1e-4
    assert ended > 30


def test_a_hanging_arm_goes_to_the_limit_without_turning_about_itself() -> None:
    """Talos' first and third axis are parallel there: whatever one turns, the other can turn back."""
    shoulder = shoulder_of(load_robot("talos"), "left_arm")
    near = np.deg2rad([-18.5, 5.3, -10.0])
    for across in np.deg2rad([-15.0, -10.0]):
        for along in np.deg2rad([0.0, 2.0, 4.0]):
            x, y = np.cos([across, along])
            tilt = np.array([[1.0, 0.0, 0.0], [0.0, x, -np.sin(across)], [0.0, np.sin(across), x]])
            tilt = np.array([[y, 0.0, np.sin(along)], [0.0, 1.0, 0.0], [-np.sin(along), 0.0, y]]) @ tilt
            asked = shoulder.goal(tilt @ shoulder.rotation(near), near)
            assert asked[1] < shoulder.lower[1]
            assert np.abs(asked - near)[[0, 2]].max() < np.deg2rad(25.0)
