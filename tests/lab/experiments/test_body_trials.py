"""Head, torso, hands and legs withdraw from touches on both robots, within the limits that the demo
reports."""

from __future__ import annotations

import pytest

from helpers.pressing import SHORT_POKE
from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.fields import default_body_fields
from tci.lab.experiments.body_trials import answerable, body_trials_of
from tci.lab.experiments.proof import trial_faults
from tci.robot.catalogue import load_robot

LACKS = {
    # This robot has no roll joint in its head, and no joints in torso and wrist.
    "nao-whole": {"left_cheek", "right_cheek", "chest", "back", "palm", "back_of_hand"},
    "icub-whole": set(),
}
TABLE = default_body_fields()


def tried_on(index: int) -> str:
    """Each field is tried on one robot: the one that can answer, or one of the two in turn."""
    able = [name for name, lacks in LACKS.items() if TABLE.field[index].name not in lacks]
    return able[index % len(able)]


@pytest.mark.parametrize("name", LACKS)
def test_every_part_withdraws(name: str) -> None:
    robot = load_robot(name)
    body = GenericBody(robot)
    able = {(field.name, part) for field in TABLE.field for part in answerable(body, field)}
    assert {site for site, _ in able} == {field.name for field in TABLE.field} - LACKS[name]
    assert len(able) == {"nao-whole": 12, "icub-whole": 20}[name]
    fields = tuple(field for index, field in enumerate(TABLE.field) if tried_on(index) == name)
    reflex = BodyWithdrawal(stance="supported", fields=TABLE.model_copy(update={"field": fields}))
    trials = list(body_trials_of(robot, reflex, stimulus=SHORT_POKE, seed=3))
    sites = {field.name for field in fields}
    assert {(trial.site, trial.part) for trial in trials} == {one for one in able if one[0] in sites}
    assert {part for _, part in able} == {trial.part for trial in trials}, "every part is tried"
    for trial in trials:
        assert not trial_faults(robot, trial), trial
