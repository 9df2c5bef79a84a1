"""Main requirement through a middleware: the reflex runs in another process, the robot and its gate in this
process."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest

import tci
from helpers.patient import patient
from helpers.pressing import SHORT_POKE
from helpers.wire_peers import wire
from tci.errors import DriverError
from tci.lab.experiments.body_trials import deaf
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.measure import Trial, measure
from tci.lab.experiments.poke import Stimulus, poke, poke_place
from tci.lab.experiments.remote_trial import RemoteTrial
from tci.runtime.loop import Tick
from tci.simulation.world import World

ROBOTS = {"zenoh": "icub", "lcm": "nao", "naoqi": "nao", "player": "icub", "ros2": "g1", "ros1": "nao"}
"""Robot by middleware; the description of g1 does not mention ROS 2. `make middleware` tests all robots over
each."""
EVERY_POKE = "zenoh"
"""Middleware that is tested with all ten pokes. The others differ only in their protocol, and are tested with
one poke of each arm."""
TRIES = 4
"""Number of attempts. On a busy machine two processes may miss periods, and the gate then correctly holds the
robot."""


def answered(trial: Trial) -> bool:
    """Returns True if the reflex in the other process responds like a reflex in this process."""
    return (
        trial.responded
        and trial.contact_lost_ms is not None
        and trial.withdrawn_mm >= trial.withdrawn_without_reflex_mm + 5.0
    )


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", ROBOTS)
def test_pokes_of_the_demo_are_answered_from_another_process(name: str) -> None:
    reflex, stimulus = tci.WithdrawalReflex(), SHORT_POKE
    nothing = replace(reflex, fields=())
    robot, fields = patient(ROBOTS[name]), reflex.fields if name == EVERY_POKE else reflex.fields[:1]
    world = World(robot, seed=3)
    with wire(name) as via, RemoteTrial(robot, via, reflex) as elsewhere:
        for part, field in product(("left_arm", "right_arm"), fields):
            held = poke(world, part, field, stimulus, reflex=nothing, seed=3)
            for _ in range(TRIES):
                acted = poke(world, part, field, stimulus, reflex=reflex, seed=3, elsewhere=elsewhere)
                trial = measure(robot, part, field.name, acted, held)
                assert not trial.violations
                assert trial.contact_lost_without_reflex_ms is None
                assert trial.cop_error_mm is not None
                assert trial.cop_error_mm <= 1.0
                if answered(trial):
                    break
            assert answered(trial), trial


def test_what_keeps_the_other_process_away_is_told() -> None:
    with pytest.raises(DriverError, match="zenoh"):
        next(trials_of(tci.load_robot("nao"), tci.WithdrawalReflex(), stimulus=Stimulus(), seed=3,
                       via="zenoh:no-endpoint"))  # fmt: skip


def test_a_wire_without_skin_is_told_with_what_to_add() -> None:
    """Unitree's own wire has joints only: 0 of 10 pokes were answered, without a reason."""
    with (
        wire("unitree") as via,
        pytest.raises(DriverError, match=r"carries no skin of g1: .*valid: .*yarp"),
    ):
        next(trials_of(patient("g1"), tci.WithdrawalReflex(), stimulus=SHORT_POKE, seed=3, via=via))


def test_a_process_that_ends_in_the_middle_of_a_trial_is_told() -> None:
    robot, reflex = tci.load_robot("nao"), tci.WithdrawalReflex()
    with wire("zenoh") as via, RemoteTrial(robot, via, reflex) as elsewhere:

        def end(tick: Tick) -> None:
            elsewhere._process.kill()

        with pytest.raises(DriverError, match=r"the process with the reflex, connected by zenoh.*: ended"):
            poke(World(robot), "left_arm", reflex.fields[0], Stimulus(), reflex=reflex, seed=3,
                 watch=end, elsewhere=elsewhere)  # fmt: skip


def test_a_head_is_withdrawn_from_another_process() -> None:
    """Tests the reflex of head, torso and legs in another process, on a robot without a binding to the
    middleware."""
    robot, reflex = patient("nao-whole"), tci.BodyWithdrawal()
    world, body = World(robot), tci.GenericBody(robot)
    field = next(one for one in reflex.fields.field if one.kind == "head")
    place = body.landmark("head", field.landmark)
    held = poke_place(world, place, SHORT_POKE, reflex=deaf(reflex), seed=3)
    with wire("zenoh") as via, RemoteTrial(robot, via, reflex) as elsewhere:
        for _ in range(TRIES):
            acted = poke_place(world, place, SHORT_POKE, reflex=reflex, seed=3, elsewhere=elsewhere)
            trial = measure(robot, "head", field.name, acted, held)
            assert not trial.violations
            if trial.responded:
                return
    raise AssertionError(trial)
