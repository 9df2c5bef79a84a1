"""A field from motion capture of a person who is touched, and what robots make of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from helpers.command_line import tci
from helpers.motion_capture import bvh
from tci.body.generic_body import GenericBody
from tci.body.posture import to_platform
from tci.capabilities.fields import load_fields
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.gestures.gesture import Gesture, fit
from tci.messages import GenericCommand, JointReading, Mode
from tci.messages.frames import Array, read_only
from tci.robot.catalogue import load_robot
from tci.robot.generic_arm import forearm_rotation, upper_arm_rotation
from tci.robot.joint_map import initial_position
from tci.runtime.arguments import load_capability

BEFORE, AFTER = np.deg2rad([20.0, 25.0, 0.0, 50.0, 0.0]), np.deg2rad([45.0, 12.0, 0.0, 75.0, 0.0])
REST, GOES, PERIOD = 20, 10, 0.05
"""Frames at rest, frames of the withdrawal, and the time [s] of a frame."""


def poked() -> Array:
    """Generic angles (k, 5) [rad] of a person who draws the arm away and comes back."""
    rise = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, GOES + 1))
    share = np.concatenate([np.zeros(REST), rise, rise[-2::-1]])
    return BEFORE + share[:, None] * (AFTER - BEFORE)


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("people")
    (folder / "poked.bvh").write_text(bvh(poked(), rest=0.0))
    place = ("--place", "left forearm outside", "--json")
    told = json.loads(tci("gesture", "field", f"{folder}/poked.bvh", f"{folder}/people.toml", *place))
    return folder / "people.toml", told


def test_the_motion_is_that_of_the_person(learnt: tuple[Path, dict[str, object]]) -> None:
    file, told = learnt
    (field,) = load_fields(file)
    assert (field.name, field.segment, field.u) == ("forearm_outside", "forearm", 0.6)
    assert np.rad2deg(field.theta) == pytest.approx(90.0)
    np.testing.assert_allclose(np.rad2deg(field.motion), np.rad2deg(AFTER - BEFORE), atol=1.0)
    assert told["to_s"] == pytest.approx((REST + GOES) * PERIOD, abs=0.06)


@pytest.mark.parametrize("name", ["nao", "icub", "g1", "talos", "alex"])
def test_a_robot_moves_its_hand_as_the_person_did(name: str, learnt: tuple[Path, dict[str, object]]) -> None:
    robot, (field,) = load_robot(name), load_fields(learnt[0])
    body, part = GenericBody(robot), robot.part("left_arm")
    stands = fit(robot, Gesture([0.0, 1.0], {"left_arm": [BEFORE, BEFORE]})).gesture.postures["left_arm"][0]
    moved = np.subtract(*(hand(body, stands + way) for way in (np.array(field.motion), 0.0)))
    person = capture(AFTER) - capture(BEFORE)
    cosine = moved @ person / np.linalg.norm(moved) / np.linalg.norm(person)
    assert part.side == "left"
    assert np.rad2deg(np.arccos(cosine)) <= 10.0


def hand(body: GenericBody, angles: Array) -> Array:
    """The hand (3,) [m] of a robot relative to its shoulder, in the torso frame."""
    command = to_platform(body.robot, GenericCommand("left_arm", Mode.POSITION, angles))
    position = np.array(initial_position(body.robot))
    position[command.servos] = command.values
    joints = JointReading(0.0, 1, read_only(position), read_only(np.zeros(len(position))))
    posture = body.posture(joints)["left_arm"]
    upper, fore = (
        body.skin.segment_pose("left_arm", name, joints, posture) for name in ("upper_arm", "forearm")
    )
    length = body.robot.part("left_arm").segment("forearm").length
    tip: Array = fore[:3, 3] - length * fore[:3, 2] - upper[:3, 3]
    return tip


def capture(angles: Array) -> Array:
    """The hand (3,) of the person in the file relative to the shoulder, in the torso frame."""
    upper = upper_arm_rotation(angles, "left", axial=True)
    fore = forearm_rotation(angles, "left", axial=True)
    tip: Array = -28.0 * upper[:, 2] - 25.0 * fore[:, 2]
    return tip


def test_a_learnt_file_runs_and_grows(learnt: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    file = tmp_path / "people.toml"
    file.write_text(learnt[0].read_text())
    (tmp_path / "poked.bvh").write_text(bvh(poked(), rest=0.0))
    tci("gesture", "field", f"{tmp_path}/poked.bvh", str(file), "--place", "right elbow", "--at", "0.9")
    assert [field.name for field in load_fields(file)] == ["forearm_outside", "elbow"]
    reflex = load_capability(str(file))
    assert isinstance(reflex, WithdrawalReflex)
    assert [field.name for field in reflex.fields] == ["forearm_outside", "elbow"]
    text = str(file.with_suffix(".txt"))
    refused = tci("gesture", "field", f"{tmp_path}/poked.bvh", text, "--place", "left elbow", status=1)
    assert "valid: a .toml file" in refused
    said = tci("run", str(file), "nao", "--poke", "--duration", "1.5")
    assert "touched" in said


@pytest.mark.parametrize(
    ("place", "at", "words"),
    [
        ("left knee", "1", "left knee.*left forearm outside"),
        ("left elbow", "9", "touched at 9 s; valid: 0 to"),
        ("left elbow", "0.0", "no withdrawal; valid: 20 degrees or more"),
        (
            "left forearm inside",
            "0.9",
            r"towards whoever touches it, by \d+ % .* no withdrawal; valid: .*--at",
        ),
        ("left forearm front", "0.9", "towards whoever touches it"),
        ("left forearm outside", "0.9", "has a field forearm_outside; valid: another --name"),
    ],
)
def test_what_shows_no_withdrawal_is_refused(
    place: str, at: str, words: str, learnt: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    file = tmp_path / "people.toml"
    file.write_text(before := learnt[0].read_text())
    still = np.concatenate([np.tile(BEFORE, (40, 1)), poked()])
    (tmp_path / "poked.bvh").write_text(bvh(still if at == "0.0" else poked(), rest=0.0))
    told = tci("gesture", "field", f"{tmp_path}/poked.bvh", str(file), "--place", place, "--at", at, status=1)
    assert re.search(words, told)
    assert file.read_text() == before
