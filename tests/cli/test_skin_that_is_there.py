"""Every tool works on the skin that is there, says what has none, and ends well: on NAOs as they are sold,
and on a robot with one patch of 64 taxels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import tci as library
from helpers.command_line import tci
from helpers.one_patch import write_one_patch
from tci.capabilities.policy import PolicySpec
from tci.learn import TouchEnv
from tci.touches import Touch, write_touches

FELT = {
    "nao-plain": {"head", "left_hand", "right_hand", "left_bumper", "right_bumper"},
    "nao-plain-h21": {"head", "left_bumper", "right_bumper"},
    "one-patch": {"patch"},
}
BARE = {
    "nao-plain": "forearm of left_arm",
    "nao-plain-h21": "left_arm",
    "one-patch": "upper arm of right_arm",
}


@pytest.fixture(scope="module")
def patch(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_one_patch(tmp_path_factory.mktemp("robot")))


def given(name: str, patch: str) -> str:
    return patch if name == "one-patch" else name


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("name", FELT)
def test_a_poke_touches_what_exists_and_is_filmed(name: str, patch: str, tmp_path: Path) -> None:
    words = ("run", "withdrawal", given(name, patch), "--poke", "--duration")
    said = flat(tci(*words, "0.02", "--film", str(tmp_path / "film.gif"), status=1))
    assert "did not touch" in said
    assert BARE[name] in said
    with Image.open(tmp_path / "film.gif") as film:
        assert np.ptp(np.asarray(film.convert("L"))) > 50
    told = json.loads(tci(*words, "0.7", "--json"))
    assert {*told["touched_N"]} <= FELT[name]
    assert told["touched_N"]
    assert bool(told["moved_rad"]) is (name == "one-patch")
    assert bool(told["lacks"]) is (name != "one-patch")
    assert bool(told["switches"]) is (name != "one-patch")


def test_one_file_touches_every_robot_where_it_has_skin(tmp_path: Path) -> None:
    touches = [Touch("press", place, 0.3, 0.2, force=5.0) for place in ("left forearm", "forehead")]
    write_touches(tmp_path / "visit.tsv", touches)
    for robot, left_out in (("nao-plain", "press left forearm"), ("icub", "press forehead")):
        words = "run", "withdrawal", robot, "--touches", str(tmp_path / "visit.tsv"), "--duration", "0.8"
        told = json.loads(tci(*words, "--json"))
        assert told["left_out"] == [left_out]
        assert len(told["touched_N"]) == 1
        assert not told["missed_touches"]
    said = flat(tci(*words[:2], "nao-plain", *words[3:]))
    assert f"nao-plain has no skin on upper arm and {BARE['nao-plain']}" in said
    assert "left out, since nao-plain has no skin there: press left forearm" in said
    write_touches(tmp_path / "visit.tsv", touches[:1])
    refused = flat(tci(*words[:2], "nao-plain", *words[3:], status=1))
    assert "line 2: nao-plain has no skin on 'left forearm'" in refused
    assert "valid: forehead" in refused


def test_without_what_it_needs_it_says_so_and_what_can_be_done() -> None:
    said = flat(tci("run", "withdrawal", "nao-plain", "--poke", "--duration", "0.5"))
    assert said.startswith("withdrawal: no skin on an arm of this robot it runs and may move nothing")
    assert "soft-reaction" in said[: said.index("tci robots")]
    assert "touched head (pressed); WithdrawalReflex: no skin on an arm of this robot" in said
    assert "nothing moved" not in said


def test_the_demo_pokes_what_exists(patch: str, tmp_path: Path) -> None:
    said = flat(tci("demo", patch, "nao-plain-h21", "--out", str(tmp_path), "--headless"))
    report = json.loads((tmp_path / "report.json").read_text())
    poked = {name: [one["site"] for one in report["trials"] if one["robot"] == name] for name in FELT}
    assert {*poked["nao-plain-h21"]} == FELT["nao-plain-h21"]
    assert len(poked["one-patch"]) >= 1
    answered = {"one-patch": {*poked["one-patch"]}, "nao-plain-h21": {"head"}}
    assert all(one["responded"] is (one["site"] in answered[one["robot"]]) for one in report["trials"])
    assert "no capability of TCI answers left_bumper, right_bumper" in said
    assert "poked what nao-plain-h21 has: head-stop" in said
    assert all(one["peak_force_n"] > 4.0 for one in report["trials"])
    assert f"one-patch has no skin on left_arm, {BARE['one-patch']}" in said
    assert "nao-plain-h21 has no skin on left_arm, right_arm, torso" in said
    with Image.open(tmp_path / "demo.png") as picture:
        assert picture.width > 1000


def test_the_check_proves_what_exists(patch: str) -> None:
    said = flat(tci("check", patch, "--simulate"))
    assert "one-patch: proved in simulation" in said
    assert "1 of 1 patches moved away" in said
    assert f"no skin on left_arm, {BARE['one-patch']}" in said


@pytest.mark.parametrize("name", FELT)
def test_an_episode_pokes_what_exists(name: str, patch: str, caplog: pytest.LogCaptureFixture) -> None:
    spec = PolicySpec(("offset", "contacts", "taxels"))
    env = TouchEnv(library.load_robot(given(name, patch)), policy=spec)
    assert BARE[name] in caplog.text
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        contact, felt = np.zeros(28), 0.0
        joints = len(env.policy.joints)
        for _ in range(75):
            assert env.observation_space.contains(observation)
            observation = env.step(np.zeros(joints))[0]
            contact = np.maximum(contact, np.abs(observation[joints : joints + 28]))
            felt = max(felt, float(np.abs(observation[joints + 28 :]).max()))
        assert felt > 0.1, seed
        assert contact.max() > 0.1, seed
    env.close()
