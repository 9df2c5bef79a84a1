"""Further robots, which consist only of descriptions, meet the same requirements as NAO and iCub."""

from __future__ import annotations

import pytest

from helpers.pressing import SHORT_POKE
from tci.body.generic_body import GenericBody
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.same_stimulus import same_stimulus
from tci.robot.catalogue import load_robot

SIDES = {"g1": "left", "alex": "right", "talos": "left"}
"""Poked arm of each robot. On NAO and iCub both are poked, with the same mirrored fields."""
NAMES = tuple(SIDES)
TRAVELS = {"talos"}
"""Robots whose shoulder centre moves: the first two axes of Talos' shoulder are 137 mm apart."""


@pytest.mark.parametrize("name", NAMES)
def test_the_demo_passes(name: str) -> None:
    trials = list(
        trials_of(load_robot(name), WithdrawalReflex(), stimulus=SHORT_POKE, seed=3, sides=(SIDES[name],))
    )
    assert len(trials) == 5
    for trial in trials:
        assert trial.responded, trial
        assert trial.contact_lost_ms is not None, trial
        assert trial.contact_lost_ms <= 500.0, trial
        assert trial.contact_lost_without_reflex_ms is None, trial
        assert trial.withdrawn_mm >= trial.withdrawn_without_reflex_mm + 5.0, trial
        assert trial.limit_violations == 0, trial.violations
        assert not trial.halts
        assert trial.first_motion_ms is not None, trial
        assert trial.first_motion_ms <= 33.0, trial
        assert trial.cop_error_mm is not None, trial
        assert trial.cop_error_mm <= 1.0, trial


@pytest.mark.parametrize("name", NAMES)
def test_the_same_touch_gets_the_same_answer(name: str) -> None:
    reflex = WithdrawalReflex()
    same = same_stimulus([GenericBody(load_robot(robot)) for robot in ("nao", "icub", name)], reflex.fields)
    print(name, same)
    assert same.max_generic_difference_rad <= 1e-9
    assert max(same.hand_direction_deg.values()) <= 10.0
    if name not in TRAVELS:
        assert max(same.hand_direction_torso_deg.values()) <= 10.0
