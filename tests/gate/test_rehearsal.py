"""A gate rehearses a motion when it is created, and discards it."""

from __future__ import annotations

import numpy as np
import pytest

from tci.gate.gate import Gate
from tci.gate.motion_planner import MotionPlanner
from tci.messages import JointReading
from tci.robot.catalogue import load_robot
from tci.robot.description import Limits, Robot
from tci.robot.joint_map import initial_position


def _steps(monkeypatch: pytest.MonkeyPatch, robot: Robot) -> tuple[list[bool], Gate]:
    """Returns a new gate, and for each step that it planned meanwhile, True if the step moves."""
    steps: list[bool] = []
    step = MotionPlanner.step

    def seen(planner: MotionPlanner) -> object:
        state = step(planner)
        steps.append(state is not None and bool(state[1].any()))
        return state

    monkeypatch.setattr(MotionPlanner, "step", seen)
    return steps, Gate(robot, period=0.01, stale_after=0.1)


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_a_rehearsal_moves_one_group_and_commands_no_servo(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = load_robot(name)
    steps, gate = _steps(monkeypatch, robot)
    assert steps == [True]
    position = np.array(initial_position(robot))
    sent = gate.step((), JointReading(0.0, 1, position, np.zeros(len(position))), 0.0)
    assert not sent.servos.size
    assert not gate.targets.size


def test_a_robot_without_known_limits_needs_no_rehearsal(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("nao")
    unknown = tuple(
        servo.model_copy(update={"limits": servo.limits.model_copy(update={"jerk": None})})
        for servo in robot.servos
    )
    assert isinstance(unknown[0].limits, Limits)
    steps, _ = _steps(monkeypatch, robot.model_copy(update={"servos": unknown}))
    assert steps == []
