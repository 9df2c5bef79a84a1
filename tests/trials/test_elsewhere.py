"""The main job through a middleware: the reflex in another process, the robot behind its own gate here."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import pytest

import tci
from middleware.links import free_port, lcm_url
from middleware.patient import patient
from middleware.ros_robots import anywhere, here_only, roscore
from middleware.served import needs_qi
from tci.errors import LinkError
from tci.trials.experiment import trials_of
from tci.trials.poke import Stimulus

VIAS: dict[str, Callable[[], str]] = {
    "zenoh": lambda: f"zenoh:tcp/127.0.0.1:{free_port()}",
    "lcm": lambda: f"lcm:{lcm_url()}",
    "naoqi": lambda: f"naoqi:127.0.0.1:{free_port()}",
    "player": lambda: f"player:127.0.0.1:{free_port()}",
    "ros2": lambda: f"ros2:{anywhere()}",
    "ros1": lambda: f"ros1:{anywhere()}",
}
TRIES = 4
"""A busy machine may keep two processes from being real time: then the robot holds, as it should."""


@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", VIAS)
def test_the_reflex_withdraws_the_arm_from_another_process(name: str) -> None:
    if name == "naoqi":
        needs_qi()
    if name == "ros2":
        here_only()
    if name == "ros1":
        roscore()
    robot, reflex = patient("nao"), tci.WithdrawalReflex()
    for _ in range(TRIES):
        trials = list(islice(trials_of(robot, reflex, stimulus=Stimulus(), seed=3, via=VIAS[name]()), 2))
        for trial in trials:
            assert not [words for words in trial.violations if not words.startswith("hold:")]
        if all(trial.responded and trial.contact_lost_ms is not None for trial in trials):
            break
    for trial in trials:
        assert trial.responded
        assert trial.contact_lost_ms is not None
        assert trial.withdrawn_mm > 30.0


def test_what_keeps_the_other_process_away_is_told() -> None:
    with pytest.raises(LinkError, match="zenoh"):
        next(trials_of(tci.load_robot("nao"), tci.WithdrawalReflex(), stimulus=Stimulus(), seed=3,
                       via="zenoh:no-endpoint"))  # fmt: skip
