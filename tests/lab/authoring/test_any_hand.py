"""Descriptions are proposed for hands of all kinds: the fingers are mapped correctly, or the hand is refused
with advice."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from helpers import made_hands
from helpers.made_hands import Chain, tips, with_hands
from helpers.made_humanoid import MadeHumanoid
from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.generic_fingers import JOINTS
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot
from tci.skin.surfaces import build_surface

EXPECTED = {
    "inspire": {
        "thumb_spread": "thumb_proximal_yaw", "thumb_flexion": "thumb_proximal_pitch",
        "index_flexion": "index_proximal", "middle_flexion": "middle_proximal",
        "ring_flexion": "ring_proximal", "little_flexion": "pinky_proximal",
    },
    "shadow": {
        "thumb_spread": "THJ4", "thumb_flexion": "THJ2 THJ1", "index_spread": "FFJ4",
        "index_flexion": "FFJ3 FFJ2 FFJ1", "middle_spread": "MFJ4", "middle_flexion": "MFJ3 MFJ2 MFJ1",
        "ring_spread": "RFJ4", "ring_flexion": "RFJ3 RFJ2 RFJ1", "little_spread": "LFJ4",
        "little_flexion": "LFJ3 LFJ2 LFJ1",
    },
    "allegro": {
        "thumb_spread": "joint_12", "thumb_flexion": "joint_14 joint_15", "index_spread": "joint_0",
        "index_flexion": "joint_0_1 joint_0_2 joint_0_3", "middle_spread": "joint_4",
        "middle_flexion": "joint_4_1 joint_4_2 joint_4_3", "ring_spread": "joint_8",
        "ring_flexion": "joint_8_1 joint_8_2 joint_8_3",
    },
    "dex3": {
        "thumb_spread": "hand_thumb_0", "thumb_flexion": "hand_thumb_1 hand_thumb_2",
        "index_flexion": "hand_index_0 hand_index_1", "middle_flexion": "hand_middle_0 hand_middle_1",
    },
}  # fmt: skip
"""Joints of the model for each generic joint, by kind of hand."""
EXPECTED["folding"] = EXPECTED["inspire"]


def handed(folder: Path, chains: Sequence[Chain], **changed: object) -> Path:
    return with_hands(MadeHumanoid(legs=False).urdf(folder), chains, **changed)


def kept(robot: Robot, path: Path) -> Robot:
    """Returns the robot after it was written to a file and read again."""
    target = path.parent / "robot.xml"
    target.write_text(write_robot(robot, file=path.name))
    return read_robot(target)


class Bent:
    """Computes positions of the finger tips of one hand in the torso frame, while the arm hangs as in the
    model."""

    def __init__(self, robot: Robot, side: str, ends: Mapping[str, Array]) -> None:
        self._part, self._map = robot.part(f"{side}_fingers"), joint_map(robot, f"{side}_fingers")
        mirror = np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
        self._ends = {f"{side}_{name}_link": end * mirror for name, end in ends.items()}
        self._kinematics = KinematicChain(robot)
        self._start = np.zeros(len(robot.servos))
        self._start[self._map.servos] = initial_position(robot)[self._map.servos]

    def moved(self, finger: str, joint: str, by: float, **angles: float) -> Array:
        """Returns the displacement (3,) [m] of a finger tip when a generic joint turns `by` [rad] while other
        joints are at `angles` [rad]."""
        generic = self._map.to_generic(self._start)
        for one in self._part.servos:
            generic[one.id] = angles.get(one.name, generic[one.id])
        before = self._tip(finger, generic)
        generic[JOINTS.index(joint)] += by
        return self._tip(finger, generic) - before

    def _tip(self, finger: str, generic: Array) -> Array:
        position = self._start.copy()
        position[self._map.servos] = self._map.to_robot(generic, position)
        link = self._part.segment(finger).link
        pose = self._kinematics.poses(position, [link])[link]
        there: Array = pose[:3, 3] + pose[:3, :3] @ self._ends[link]
        return there


@pytest.mark.parametrize("kind", EXPECTED)
def test_fingers_of_each_kind_of_hand_are_found(kind: str, tmp_path: Path) -> None:
    make: Callable[[], list[Chain]] = getattr(made_hands, kind)
    path = handed(tmp_path, make())
    robot = kept(propose(path, name="made"), path)
    for side, palmar in (("left", -1.0), ("right", 1.0)):
        part = robot.part(f"{side}_fingers")
        found = {
            one.name: " ".join(str(robot.servos[servo].joint) for servo in one.moved).replace(f"{side}_", "")
            for one in part.servos if one.moved
        }  # fmt: skip
        assert found == EXPECTED[kind]
        bent = Bent(robot, side, tips(make()))
        for finger in sorted({name.partition("_")[0] for name in found} - {"thumb"}):
            flexion, spread = f"{finger}_flexion", f"{finger}_spread"
            assert palmar * bent.moved(finger, flexion, 0.4)[1] > 0.01, f"{finger} bends to the palm"
            if spread in found:
                way = bent.moved(finger, spread, 0.2, **{flexion: 0.6})[0]
                assert way * (1.0 if finger in ("index", "middle") else -1.0) > 0.003, f"{finger} spreads"
        way = bent.moved("thumb", "thumb_spread", 0.3, thumb_flexion=0.5)
        assert palmar * way[1] - way[0] > 0.003, "the thumb opposes"


def test_skin_on_hands_lies_on_the_palm_and_around_the_tips(tmp_path: Path) -> None:
    path = handed(tmp_path, made_hands.dex3())
    robot = propose(path, name="made", skin_on_hands=True)
    assert not [patch for patch in propose(path, name="made").patches if "fingers" in patch.part]
    for side, inward in (("left", -1.0), ("right", 1.0)):
        own = [patch for patch in robot.patches if patch.part == f"{side}_fingers"]
        names = [f"{side}_{name}" for name in ("thumb_tip", "index_tip", "middle_tip", "palm")]
        assert [patch.name for patch in own] == names
        surfaces = {patch.name: build_surface(robot, patch, KinematicChain(robot)) for patch in own}
        palm = surfaces[f"{side}_palm"]
        front = palm.positions[palm.normals[:, 1] * inward > 0.9]
        assert len(front) > 5, "it faces the body, as the palm does"


def test_a_finger_without_a_torque_limit_is_assumed_weak(tmp_path: Path) -> None:
    """With the torque of an arm, the fingers of a genuine Allegro hand pressed with 11 N on a ball."""
    path = handed(tmp_path, made_hands.dex3(), motor=(0.0, 6.28))
    limits = {servo.joint: servo.limits for servo in kept(propose(path, name="made"), path).servos}
    assert limits["left_hand_index_0"].torque == 1.0
    assert "torque" in limits["left_hand_index_0"].assumed
    assert limits["left_wrist_pitch"].torque == 30.0


def test_followers_move_with_their_finger(tmp_path: Path) -> None:
    path = handed(tmp_path, made_hands.inspire())
    robot = kept(propose(path, name="made"), path)
    servo = next(servo for servo in robot.servos if servo.joint == "left_index_proximal")
    assert [(one.joint, one.multiplier) for one in servo.mimics] == [("left_index_intermediate", 1.1)]
    assert not [servo for servo in robot.servos if "intermediate" in str(servo.joint)]


def test_the_outer_motors_of_a_finger_follow_its_first_in_the_ratio_of_their_ranges(tmp_path: Path) -> None:
    path = handed(tmp_path, made_hands.dex3())
    robot = kept(propose(path, name="made"), path)
    joints = joint_map(robot, "left_fingers")
    generic = joints.to_generic(np.zeros(len(robot.servos)))
    assert generic[0] == pytest.approx(np.pi / 2.0), "its thumb is across the palm at the model's zero"
    generic[1] = 0.6
    angles = dict(
        zip(joints.servos.tolist(), joints.to_robot(generic, np.zeros(len(robot.servos))), strict=True)
    )
    names = {str(robot.servos[servo].joint): angle for servo, angle in angles.items()}
    assert names["left_hand_thumb_1"] == pytest.approx(0.6)
    assert names["left_hand_thumb_2"] == pytest.approx(0.6 * 1.75 / 1.05)


def faults(path: Path) -> str:
    with pytest.raises(DescriptionError) as error:
        propose(path, name="made")
    return str(error.value)


def flexions(path: Path, trust: str) -> dict[str, str]:
    robot = propose(path, name="made", trust_fingers=trust)
    found = [part for part in robot.parts if part.name == "left_fingers"]
    return {
        one.name: str(robot.servos[one.servo].joint) for part in found for one in part.servos
        if one.servo is not None and one.name.endswith("flexion")
    }  # fmt: skip


def test_names_that_contradict_places_are_an_error_with_a_choice(tmp_path: Path) -> None:
    swapped = {
        f"hand_{a}_{i}": f"hand_{b}_{i}"
        for a, b in (("index", "middle"), ("middle", "index"))
        for i in range(2)
    }
    path = handed(tmp_path, made_hands.dex3(), names=swapped)
    words = faults(path)
    assert "fingers of the left hand" in words
    assert "by their places, from the thumb on, they are middle, index" in words
    assert "--fingers names or --fingers places or --fingers none (hands without fingers)" in words
    assert flexions(path, "names")["index_flexion"] == "left_hand_index_0"
    assert flexions(path, "places")["index_flexion"] == "left_hand_middle_0"
    assert not flexions(path, "none")


def test_a_finger_named_thumb_that_bends_as_the_others_is_doubted(tmp_path: Path) -> None:
    other = {f"joint_0{end}": f"thumb{end}" for end in ("", "_1", "_2", "_3")}
    path = handed(tmp_path, made_hands.allegro(), names=other)
    words = faults(path)
    assert "left_joint_12 bends as a thumb does, and the name of left_thumb is that of a thumb" in words
    for option in re.findall("--fingers ([a-z]+)", words):
        assert bool(flexions(path, option)) is (option != "none")


def test_limits_that_do_not_tell_a_direction_are_an_error(tmp_path: Path) -> None:
    path = handed(tmp_path, made_hands.allegro(), limits=(-1.0, 1.0))
    words = faults(path)
    assert "leave open in which direction they bend a finger; valid: --fingers none (hands" in words
    assert not flexions(path, "none")


def test_a_gripper_has_no_fingers(tmp_path: Path) -> None:
    path = handed(tmp_path, made_hands.dex3()[:2])
    assert [part.kind for part in propose(path, name="made").parts].count("fingers") == 0
