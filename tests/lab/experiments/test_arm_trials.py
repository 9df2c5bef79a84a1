"""The reflex responds to pokes anywhere on the arms. `make reliability` runs a thousand pokes on each
robot."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.arm_trials import ArmTrial, arm_trials_of
from tci.robot.catalogue import load_robot


def pokes(name: str, reflex: WithdrawalReflex, count: int) -> list[ArmTrial]:
    trials = list(arm_trials_of(load_robot(name), reflex, count=count, seed=3))
    print(*trials, sep="\n")
    return trials


# two robots that differ most: the shoulder of talos travels
@pytest.mark.parametrize("name", ["nao", "talos"])
def test_random_pokes_of_the_arms_are_answered(name: str) -> None:
    trials = pokes(name, WithdrawalReflex(), 8)
    assert not any(trial.towards for trial in trials)
    assert sum(trial.left for trial in trials) >= 7
    assert all(trial.left or trial.reason for trial in trials)
    assert json.dumps([asdict(trial) for trial in trials])  # the scoreboard requires this


def test_the_five_fields_alone_leave_much_of_the_arm_unanswered() -> None:
    """Shows that the test of all fields can fail."""
    trials = pokes("nao", WithdrawalReflex(response="meant"), 8)
    assert sum(trial.left for trial in trials) <= 6
