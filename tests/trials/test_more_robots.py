"""The main job on robots that are nothing but data: the figures of the paper's two robots hold for them."""

from __future__ import annotations

import pytest

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.interface.body import Body
from tci.model.catalogue import load_robot
from tci.trials.experiment import trials_of
from tci.trials.poke import Stimulus
from tci.trials.same_stimulus import same_stimulus

HAND = {"g1": 10.0, "alex": 10.0, "talos": 15.0}
"""Largest angle [degrees] between a hand's way and a NAO's. The axes of a Talos' shoulder pass each other at
137 mm, so its shoulder itself moves when it turns."""


@pytest.mark.parametrize("name", HAND)
def test_the_demo_passes(name: str) -> None:
    trials = list(trials_of(load_robot(name), WithdrawalReflex(), stimulus=Stimulus(), seed=3))
    assert len(trials) == 10
    for trial in trials:
        assert trial.responded, trial
        assert trial.contact_lost_ms is not None, trial
        assert trial.contact_lost_ms <= 500.0, trial
        assert trial.contact_lost_without_reflex_ms is None, trial
        assert trial.withdrawn_mm >= trial.withdrawn_without_reflex_mm + 5.0, trial
        assert trial.limit_violations == 0, trial.violations
        assert trial.first_motion_ms is not None, trial
        assert trial.first_motion_ms <= 33.0, trial
        assert trial.cop_error_mm is not None, trial
        assert trial.cop_error_mm <= 1.0, trial


@pytest.mark.parametrize("name", HAND)
def test_the_same_touch_gets_the_same_answer(name: str) -> None:
    reflex = WithdrawalReflex()
    same = same_stimulus([Body(load_robot(robot)) for robot in ("nao", "icub", name)], reflex.fields)
    print(name, same)
    assert same.max_generic_difference_rad <= 1e-9
    assert max(same.hand_direction_deg.values()) <= HAND[name]
