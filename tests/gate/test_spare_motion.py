"""A motion that is planned and never sent: a gate takes one step of it when the gate is created."""

from __future__ import annotations

import numpy as np
import pytest

from tci.gate.gate import Gate
from tci.gate.motion_planner import MotionPlanner
from tci.gate.spare_motion import SpareMotion
from tci.messages import JointReading
from tci.messages.frames import Array
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
def test_a_new_gate_takes_one_step_and_commands_no_servo(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(name)
    steps, gate = _steps(monkeypatch, robot)
    assert steps == [True]
    position = np.array(initial_position(robot))
    sent = gate.step((), JointReading(0.0, 1, position, np.zeros(len(position))), 0.0)
    assert not sent.servos.size
    assert not gate.targets.size


def test_a_robot_without_known_limits_has_no_spare_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("nao")
    unknown = tuple(
        servo.model_copy(update={"limits": servo.limits.model_copy(update={"jerk": None})})
        for servo in robot.servos
    )
    assert isinstance(unknown[0].limits, Limits)
    steps, _ = _steps(monkeypatch, robot.model_copy(update={"servos": unknown}))
    assert steps == []


def test_every_step_plans_a_motion_to_the_other_target(monkeypatch: pytest.MonkeyPatch) -> None:
    targets: list[bytes] = []
    plan = MotionPlanner.set_targets

    def seen(planner: MotionPlanner, target: Array, speed: Array) -> None:
        targets.append(target.tobytes())
        plan(planner, target, speed)

    monkeypatch.setattr(MotionPlanner, "set_targets", seen)
    robot = load_robot("icub")
    steps, _ = _steps(monkeypatch, robot)
    motion = SpareMotion(robot, period=0.01, speed_share=1.0)
    targets.clear()
    for _ in range(40):
        motion.step()
    assert steps == [True] * 41
    assert targets == targets[:2] * 20
    assert targets[0] != targets[1]
