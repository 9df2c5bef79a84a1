"""What LeRobot's programs see of a robot, and how hands guide it (`make lerobot`: in LeRobot itself)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers import ROOT
from tci.errors import DriverError, TciError
from tci.learn import NamedRobot

TOUCH = "push 'left forearm' 5N 0.9s"


def test_hands_guide_an_arm_and_what_is_recorded_leads_it_there_again(tmp_path: Path) -> None:
    with NamedRobot("icub", touches=[TOUCH], record=str(tmp_path / "one.mcap"), task="go along") as robot:
        begun, asked = robot.observe(), list[dict[str, float]]()
        for _ in range(60):
            seen = robot.observe()
            assert [*seen] == [*robot.observed]
            asked.append(robot.guide())
            sent = robot.act(asked[-1])
            assert [*sent] == [*robot.actions]
            assert all(abs(sent[name] - seen[name]) < 0.3 for name in robot.actions)
        force = seen["left_arm.contact0.force"]
        end = robot.observe()
    left = [name for name in robot.actions if name.startswith("left_arm.")]
    assert np.rad2deg(max(abs(end[name] - begun[name]) for name in left)) > 15.0
    assert max(abs(end[n] - begun[n]) for n in robot.actions if n not in left) < np.deg2rad(1.0)
    assert force == 0.0, "the hand is gone"
    assert max(abs(asked[-1][name] - end[name]) for name in robot.actions) < np.deg2rad(1.5), "it stays there"
    recorded = list(tci.Recording(tmp_path / "one.mcap").ticks())
    assert recorded[-1].now - recorded[0].now > 1.9
    assert next(tci.Recording(tmp_path / "one.mcap").touching(), None) is not None, "films show the hand"
    with NamedRobot("icub") as other:  # nobody touches it
        for action in asked:
            other.observe()
            other.act(action)
        again = other.observe()
    assert max(abs(again[name] - end[name]) for name in robot.actions) < np.deg2rad(2.0)


def test_a_wrong_action_is_one_error_and_orders_nothing() -> None:
    robot = NamedRobot("nao", parts=["left_arm"], observations=["posture", "taxels"])
    assert len(robot.actions) == 5
    assert set(robot.actions) < set(robot.observed)
    assert sum(name.endswith(".force") for name in robot.observed) > 50
    with pytest.raises(DriverError, match="not connected"):
        robot.observe()
    with robot:
        here = robot.observe()
        rest = {name: here[name] for name in robot.actions}
        for wrong in ({**rest, robot.actions[0]: float("nan")}, {**rest, "left_arm.nose.pos": 0.0}, {}):
            with pytest.raises(
                TciError, match=r"valid: one finite number for each of left_arm\.shoulder_pitch"
            ):
                robot.act(wrong)
        assert robot.act(rest) == pytest.approx(rest, abs=1e-3)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"parts": ["wing"]}, "left_arm"), ({"observations": ["smell"]}, "posture, velocity"),
        ({"rate": 0.0}, "above 0"), ({"via": "naoqi:nao.local", "touches": [TOUCH]}, "over sim"),
    ],
)  # fmt: skip
def test_what_can_not_be_is_one_error(options: dict[str, object], says: str) -> None:
    with pytest.raises(TciError, match=says):
        NamedRobot("nao", **options)  # type: ignore[arg-type]


def test_what_fails_while_it_opens_leaves_it_closed(tmp_path: Path) -> None:
    robot = NamedRobot("nao", picture=(0, 12), record=str(tmp_path / "one.mcap"))
    with pytest.raises(TciError, match="at least 1 x 1"):
        robot.connect()
    assert not robot.is_connected
    assert tci.Recording(tmp_path / "one.mcap").topics() == {}


def test_hands_can_not_guide_what_does_not_feel_how_hard_it_is_pushed() -> None:
    with NamedRobot("nao", parts=["head"]) as robot, pytest.raises(TciError, match="valid: left_arm"):
        robot.guide()


def test_lerobot_finds_the_plug_in_by_its_name() -> None:
    """LeRobot imports a module of the name of each distribution that begins with `lerobot_robot_`."""
    folder = ROOT / "packages" / "lerobot_robot_tci"
    name = tomllib.loads((folder / "pyproject.toml").read_text())["project"]["name"]
    assert name == "lerobot_robot_tci"
    assert (folder / name / "__init__.py").exists()
