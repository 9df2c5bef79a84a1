"""The judge of proposed descriptions, which shares no code with the proposal, accepts correct descriptions
and refuses wrong ones."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from helpers.made_humanoid import MadeHumanoid
from helpers.programs import program
from tci.lab.authoring.proposal import propose
from tci.robot.description import GenericPart, Robot


@pytest.fixture(scope="module")
def judge() -> ModuleType:
    return program("judge_proposal")


@pytest.fixture(scope="module")
def proposed(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return propose(MadeHumanoid().urdf(tmp_path_factory.mktemp("made")), name="made")


def changed(robot: Robot, name: str, joint: str, **changes: object) -> Robot:
    """Returns the robot with changed values of one generic joint."""
    part = robot.part(name)
    servos = tuple(one.model_copy(update=changes) if one.name == joint else one for one in part.servos)
    return with_part(robot, part.model_copy(update={"servos": servos}), f"{name} {joint} {changes}")


def with_part(robot: Robot, part: GenericPart, digest: str) -> Robot:
    parts = tuple(part if one.name == part.name else one for one in robot.parts)
    return robot.model_copy(update={"parts": parts, "digest": digest})


def test_right_proposals_are_right(proposed: Robot, judge: ModuleType, tmp_path: Path) -> None:
    assert judge.complaints(proposed) == []
    below = propose(MadeHumanoid(from_torso=True, slant=0.5).urdf(tmp_path), name="below")
    assert judge.complaints(below) == []


@pytest.mark.parametrize(
    ("part", "joint"),
    [("left_arm", "elbow_yaw"), ("right_hand", "deviation"), ("head", "yaw"), ("head", "pitch"),
     ("torso", "yaw"), ("left_leg", "hip_pitch"), ("left_leg", "knee_pitch"), ("right_leg", "ankle_roll"),
     ("right_leg", "hip_yaw")],
)  # fmt: skip
def test_a_wrong_sign_is_wrong(part: str, joint: str, proposed: Robot, judge: ModuleType) -> None:
    scale = next(one.scale for one in proposed.part(part).servos if one.name == joint)
    found = judge.complaints(changed(proposed, part, joint, scale=-scale))
    assert len(found) == 1
    assert found[0].startswith(f"{part} {joint}: ")


def test_an_elbow_that_bends_backward_is_wrong(judge: ModuleType, tmp_path: Path) -> None:
    path = MadeHumanoid(elbow=(-2.2, 2.2)).urdf(tmp_path)
    path.write_text(path.read_text().replace("lower='-1.5' upper='1.5'", "lower='-3.1' upper='3.1'"))
    wrong = propose(path, name="wrong", elbow=1)
    assert [one for one in judge.complaints(wrong) if one.startswith("left_arm: the initial posture")]


def test_legs_as_arms_and_exchanged_sides_are_wrong(proposed: Robot, judge: ModuleType) -> None:
    left, right = proposed.part("left_arm"), proposed.part("right_arm")
    servos = [
        one.model_copy(update={"servo": other.servo})
        for one, other in zip(left.servos, right.servos, strict=True)
    ]
    swapped = with_part(proposed, left.model_copy(update={"servos": tuple(servos)}), "other side")
    assert any("other side" in one for one in judge.complaints(swapped))
    knee = proposed.part("left_leg").servos[3].servo
    legs = judge.complaints(changed(proposed, "head", "yaw", servo=knee))
    assert any("left_knee is named as a joint of leg" in one for one in legs)


def test_a_model_has_two_arms_if_its_joints_are_named_so(judge: ModuleType) -> None:
    joints = ("shoulder_pitch", "ShoulderRoll", "arm_3", "elbow")
    assert judge.two_arms([f"{side}_{joint}" for side in ("left", "right") for joint in joints])
    assert judge.two_arms([f"{side}{joint}" for side in ("L", "R") for joint in ("Elbow",) * 4])
    assert not judge.two_arms([f"left_{joint}" for joint in joints])
    assert not judge.two_arms([f"{side}_hip_{axis}" for side in ("left", "right") for axis in "xyzabc"])


def test_sides_are_read_in_names_of_capitals(judge: ModuleType) -> None:
    named = {"J14_SHOULDER_ROLL_L": "left", "RARM_SHOULDER_R": "right", "LShoulderPitch": "left"}
    assert {name: judge.told_side(name) for name in (*named, "WAIST_ROLL")} == {**named, "WAIST_ROLL": None}


def test_a_part_that_is_left_out_is_wrong_unless_a_note_says_so(proposed: Robot, judge: ModuleType) -> None:
    parts = tuple(part for part in proposed.parts if part.kind != "leg")
    without = proposed.model_copy(update={"parts": parts, "digest": "no legs"})
    (found,) = judge.complaints(without)
    assert found.startswith("no leg, although the model has left_hip_pitch")
    joints = [servo.name for servo in proposed.servos]
    assert judge.complaints(without, [f"no legs: {', '.join(joints)}"]) == []
