"""The checker of limits detects a gate whose limits are wrong and too wide."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot, position_command
from tci.gate.gate import SafeCommand
from tci.lab.experiments.checker import command_violations, physics_violations, stray_servos
from tci.messages.frames import Array
from tci.robot.description import Limits


def motion(limits: Limits = LIMITS, *, coupled: bool = True) -> tuple[list[SafeCommand], list[Array]]:
    """Returns the commands of a gate with `limits`, and the measured angles at each command."""
    driven = Driven(make_robot(limits=limits, coupled=coupled), [0.0] * 6)
    sent, measured = [], []
    for tick in range(600):
        measured.append(driven.angles.copy())
        sent.append(driven.step(*([position_command([0, 2], [1.5, 1.9])] if tick == 0 else [])))
    return sent, measured


def test_what_keeps_the_limits_is_not_accused() -> None:
    assert command_violations(make_robot(), *motion(), PERIOD) == []


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"upper": 3.0}, None),
        ({"velocity": 6.0}, "velocity"),
        ({"velocity": 3.35}, "velocity"),  # the gate uses 0.9 of this limit: 3.015, which is 0.5 % too fast
        ({"acceleration": 90.0}, "acceleration"),
        ({"jerk": 9000.0}, "jerk"),
    ],
)
def test_each_limit_is_watched(wrong: dict[str, float], words: str | None) -> None:
    sent, measured = motion(LIMITS.model_copy(update=wrong))
    faults = command_violations(make_robot(), sent, measured, PERIOD)
    assert any(words in fault for fault in faults) if words else faults == []


def test_a_position_outside_is_seen() -> None:
    narrow = make_robot(limits=LIMITS.model_copy(update={"upper": 1.0}))
    assert any("joint2: position" in fault for fault in command_violations(narrow, *motion(), PERIOD))


def test_a_coupling_is_watched() -> None:
    sent, measured = motion(coupled=False)
    assert any("cable" in fault for fault in command_violations(make_robot(), sent, measured, PERIOD))


def test_unknown_limits_and_stray_servos_are_named() -> None:
    sent, measured = motion(coupled=False)
    unknown = make_robot(limits=LIMITS.model_copy(update={"jerk": None}), coupled=False)
    assert any("jerk is unknown" in fault for fault in command_violations(unknown, sent, measured, PERIOD))
    part = make_robot().parts[0]
    few = part.model_copy(update={"servos": part.servos[:1]})
    robot = make_robot().model_copy(update={"parts": (few,)})
    assert stray_servos(robot, {"left_arm"}, sent) == [
        "joint2: commanded, although it is no servo of left_arm"
    ]


def test_the_physics_is_watched_too() -> None:
    robot = make_robot()
    still = np.zeros((3, 6))
    assert physics_violations(robot, still, still) == []
    out, fast = still.copy(), still.copy()
    out[1, 3], fast[2, 4] = 2.1, -3.5
    assert any("joint3" in fault for fault in physics_violations(robot, out, still))
    assert any("joint4" in fault for fault in physics_violations(robot, still, fast))
    assert physics_violations(robot, out, fast, without=(out, fast)) == []
    excused = physics_violations(robot, out, fast, without=(out, fast), commanded=[3])
    assert len(excused) == 1, "what is commanded may not be pushed beyond its limits either"
    assert physics_violations(robot, out + 0.01, fast, without=(out, fast))
    assert physics_violations(robot, out, fast * 1.1, without=(out, fast))
    assert physics_violations(robot, out, fast, without=(still, still))
    assert physics_violations(robot, np.full((1, 6), np.nan), still[:1])


def test_a_push_may_make_a_joint_a_little_faster() -> None:
    """A push may exceed the speed limit a little. A command may never exceed the limit: see
    `test_each_limit_is_watched`."""
    robot = make_robot()
    top = robot.servos[4].limits.velocity
    assert top is not None
    still, pushed, wild = np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6))
    pushed[1, 4], wild[1, 4] = 1.005 * top, 1.02 * top
    assert physics_violations(robot, still, pushed) == []
    assert any("joint4" in fault for fault in physics_violations(robot, still, wild))
