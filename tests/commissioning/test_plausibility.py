"""Mistakes that are valid and yet wrong are found, and right descriptions give no doubt."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from cli.test_cli import tci
from made_humanoid import MadeHumanoid
from tci.authoring.proposal import propose
from tci.commissioning.plausibility import doubts
from tci.robot.catalogue import load_robot
from tci.robot.xml.writer import write_robot

TOOL = Path(__file__).parents[2] / "tools" / "planted.py"


@pytest.fixture(scope="module")
def planted() -> ModuleType:
    spec = importlib.util.spec_from_file_location("planted", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["planted"] = module
    spec.loader.exec_module(module)
    return module


def test_a_patch_without_taxels_has_no_scale_to_doubt() -> None:
    assert doubts(load_robot("g1-bare")) == []


@pytest.mark.parametrize("name", ["nao", "g1"])
def test_planted_mistakes_are_found_and_nothing_else_is_blamed(name: str, planted: ModuleType) -> None:
    """One of each kind; `tools/planted.py` plants more of them, on more robots."""
    robot = load_robot(name)
    assert doubts(robot) == []
    kinds = planted.mistakes(robot)
    assert len(kinds) >= 11
    for kind, mistakes in kinds.items():
        found, blamed = planted.judge(mistakes[0])
        assert found, f"{kind} of {mistakes[0].place}"
        assert not blamed, f"{kind} of {mistakes[0].place}"


def test_a_proposal_gives_no_doubt_and_the_command_shows_one(tmp_path: Path) -> None:
    robot = propose(MadeHumanoid(from_torso=True).urdf(tmp_path), name="made")
    assert doubts(robot) == []
    path = tmp_path / "robot.xml"
    text = write_robot(robot, file="made.urdf")
    path.write_text(text.replace('pascal_per_count="-600"', 'pascal_per_count="-600000"', 1))
    told = json.loads(tci("check", str(path), "--json"))["doubts"]
    assert len(told) == 1
    assert "left_upper_arm: pascal_per_count -600000" in told[0]
    assert "doubtful: left_upper_arm" in tci("check", str(path))
