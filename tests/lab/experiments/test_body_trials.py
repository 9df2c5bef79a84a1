"""Head, torso, hands and legs withdraw from touches on both robots, within the limits that the demo
reports."""

from __future__ import annotations

import pytest

from helpers.pressing import SHORT_POKE
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.fields import default_body_fields
from tci.lab.experiments.body_trials import body_trials_of
from tci.lab.experiments.proof import trial_faults
from tci.robot.catalogue import load_robot

LACKS = {
    # This robot has no roll joint in its head, and no joints in torso and wrist.
    "nao-whole": {"left_cheek", "right_cheek", "chest", "back", "palm", "back_of_hand"},
    "icub-whole": set(),
}


@pytest.mark.parametrize("name", LACKS)
def test_every_part_withdraws(name: str) -> None:
    robot = load_robot(name)
    trials = list(body_trials_of(robot, BodyWithdrawal(stance="supported"), stimulus=SHORT_POKE, seed=3))
    sites = {trial.site for trial in trials}
    assert sites == {field.name for field in default_body_fields().field} - LACKS[name]
    assert len(trials) == {"nao-whole": 12, "icub-whole": 20}[name]
    for trial in trials:
        assert not trial_faults(robot, trial), trial
