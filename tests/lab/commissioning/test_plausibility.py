"""Valid but wrong values in descriptions are found, and correct descriptions cause no doubt."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from helpers.command_line import tci
from helpers.made_humanoid import MadeHumanoid
from helpers.programs import program
from tci.lab.authoring.proposal import propose
from tci.lab.commissioning.both_sides import posture_doubts
from tci.lab.commissioning.plausibility import doubts, mirrored_limits
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericPart
from tci.robot.xml.writer import write_robot


@pytest.fixture(scope="module")
def planted() -> ModuleType:
    return program("planted")


def test_a_patch_without_taxels_has_no_scale_to_doubt() -> None:
    assert doubts(load_robot("g1-bare")) == []


@pytest.mark.parametrize("name", ["nao", "g1"])
def test_planted_mistakes_are_found_and_nothing_else_is_blamed(name: str, planted: ModuleType) -> None:
    """Tests one mistake of each kind, on a G1 of those that a NAO can't have. The program `tools/planted.py`
    tests more mistakes on more robots."""
    robot = load_robot(name)
    assert doubts(robot) == []
    kinds = planted.mistakes(robot)
    assert len(kinds) >= 12
    if name == "g1":
        kinds = {kind: kinds[kind] for kind in kinds.keys() - planted.mistakes(load_robot("nao")).keys()}
        assert kinds.keys() == {"sign of a torso", "sign of a hand", "sign of a leg"}
    for kind, mistakes in kinds.items():
        found, blamed = planted.judge(mistakes[0])
        assert found, f"{kind} of {mistakes[0].place}"
        assert not blamed, f"{kind} of {mistakes[0].place}"


def test_an_initial_angle_in_radians_on_one_side_is_doubtful_and_told(planted: ModuleType) -> None:
    robot = load_robot("icub")
    wrong = planted.mistakes(robot)["initial angle in radians on one side"][0].robot
    (found,) = posture_doubts(wrong)
    assert found.startswith("left_arm and right_arm: initial ")
    assert re.search(
        r" of \S+ and of \S+ degrees; \S+ degrees are \S+ rad; valid: equal on both sides$", found
    )


@pytest.mark.parametrize("degrees", [3.0, 20.0, -45.0])
def test_one_initial_angle_in_radians_among_degrees_is_doubtful_on_every_part(degrees: float) -> None:
    """An earlier version compared only the two sides, and only angles that differ by more than 5 degrees. It
    accepted an angle in radians for the head or the torso."""
    robot = load_robot("icub-whole")
    assert {part.kind for part in robot.parts} == {"arm", "hand", "head", "torso", "leg", "fingers"}
    for part in robot.parts:
        for joint in part.servos:
            if joint.servo is None:
                continue
            # Both sides have the angle in degrees. Then this part alone has the number of the radians.
            meant = {joint.name: float(np.deg2rad(degrees))}
            kind = tuple(with_initial(one, meant) if one.kind == part.kind else one for one in robot.parts)
            assert [*posture_doubts(robot.model_copy(update={"parts": kind}))] == []
            meant = {joint.name: float(np.deg2rad(np.deg2rad(degrees)))}
            wrong = tuple(with_initial(one, meant) if one.name == part.name else one for one in kind)
            (found,) = posture_doubts(robot.model_copy(update={"parts": wrong}))
            assert part.name in found
            assert f"initial {joint.name} of " in found
            assert f"{abs(degrees):.3g} degrees are {abs(np.deg2rad(degrees)):.3g} rad" in found.replace(
                "-", ""
            )


def with_initial(part: GenericPart, angles: dict[str, float]) -> GenericPart:
    """Returns a copy of a part with other initial angles [rad] of the named joints."""
    servos = tuple(
        one.model_copy(update={"initial": angles[one.name]}) if one.name in angles else one
        for one in part.servos
    )
    return part.model_copy(update={"servos": servos})


def test_joints_of_both_sides_are_compared_by_name() -> None:
    """An earlier version paired the joints of the two sides by their order. If the sides had different
    numbers of joints, it raised a ValueError."""
    robot = load_robot("nao")
    assert doubts(robot) == []
    for other in (lambda servos: servos[::-1], lambda servos: servos[1:]):
        parts = tuple(
            part.model_copy(update={"servos": other(part.servos)}) if part.name == "right_arm" else part
            for part in robot.parts
        )
        changed = robot.model_copy(update={"parts": parts})
        assert [*posture_doubts(changed)] == []
        assert [*mirrored_limits(changed)] == []


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


def damped(folder: Path, damping: float) -> Path:
    """Returns a humanoid whose joints have 30 N m and 6.28 rad/s as limits, and damping."""
    path = MadeHumanoid(legs=False).urdf(folder)
    text = path.read_text()
    path.write_text(text.replace("</joint>", f"<dynamics damping='{damping}' friction='1'/></joint>"))
    return path


def test_a_speed_that_damping_makes_impossible_is_lowered_and_doubted(tmp_path: Path) -> None:
    """A motor of 30 N m does not reach 6.28 rad/s against a damping of 10 N m s/rad."""
    light, heavy = tmp_path / "light", tmp_path / "heavy"
    light.mkdir()
    heavy.mkdir()
    free = propose(damped(light, 1.0), name="light")
    assert all("velocity" not in servo.limits.assumed for servo in free.servos)
    slow = propose(damped(heavy, 10.0), name="heavy")
    for servo in slow.servos:
        assert "velocity" in servo.limits.assumed
        assert servo.limits.velocity == pytest.approx((30.0 - 1.0) / 3.0 / 10.0, rel=1e-3)
    assert doubts(slow) == []
    wrong = slow.model_copy(update={"servos": free.servos, "digest": "as fast as without damping"})
    assert len(doubts(wrong)) == sum(one.servo is not None for part in slow.parts for one in part.servos)
    assert "friction and damping take 63.8 N m at the speed limit of 359.8 degrees/s" in doubts(wrong)[0]


def test_one_limit_in_radians_among_degrees_is_told() -> None:
    g1 = load_robot("g1")
    at = next(servo for servo in g1.servos if "elbow" in servo.name)
    assert at.limits.lower is not None
    assert at.limits.upper is not None
    small = {name: float(np.deg2rad(getattr(at.limits, name))) for name in ("lower", "upper")}
    servos = [
        servo.model_copy(update={"limits": at.limits.model_copy(update=small)}) if servo is at else servo
        for servo in g1.servos
    ]
    found = doubts(g1.model_copy(update={"servos": tuple(servos), "digest": "small"}))
    assert any(words.startswith(f"{at.name}: limits of") and "in radians" in words for words in found)
