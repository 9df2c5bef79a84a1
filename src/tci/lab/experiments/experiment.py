"""Trials of `tci demo`: pokes anywhere on the arms of every robot; then two comparisons of the robots, with
the same contact (`same_stimulus`) and with the same pressure (`same_touch`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from typing import Any

from tci.body.generic_body import GenericBody
from tci.body.touchable import touchable
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.measure import Trial, measure
from tci.lab.experiments.poke import Stimulus, poke_place
from tci.lab.experiments.remote_trial import RemoteTrial
from tci.lab.experiments.same_stimulus import SameStimulus, initial_joints, same_stimulus
from tci.lab.experiments.same_touch import SameTouch, same_touch
from tci.lab.experiments.trial_places import PER_ARM, SIDES, posture_of, trial_places
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class Report:
    """Contents of the file `report.json`."""

    trials: tuple[Trial, ...]
    same_stimulus: SameStimulus
    same_touch: tuple[SameTouch, ...]
    compared: tuple[str, ...] = ()
    """Robots that `same_stimulus` and `same_touch` compare: those with skin on every field."""

    def to_json(self) -> dict[str, Any]:
        """Returns the report as JSON values."""
        return asdict(self)


def trials_of(
    robot: Robot,
    reflex: WithdrawalReflex,
    *,
    stimulus: Stimulus,
    seed: int,
    via: str | None = None,
    sides: Sequence[str] = SIDES,
    count: int = PER_ARM,
) -> Iterator[Trial]:
    """Pokes `count` taxels anywhere on each arm of one robot, with and without the reflex; on a robot without
    skin there, what else it can feel with, and another capability answers (`trial_places`).

    In the trials without the reflex, the arms keep their posture in the control mode of `reflex`. If `via`
    names a middleware, what answers runs in another process and reaches the robot through this middleware.
    """
    world = World(robot, seed=seed, posture=posture_of(robot))
    places = enumerate(trial_places(world, reflex, sides, count=count, seed=seed))
    for capability, own in groupby(places, key=lambda one: one[1].answer.capability):
        with RemoteTrial(robot, via, capability) if via else nullcontext() as elsewhere:
            for index, one in own:
                answer, poke = one.answer, replace(stimulus, depth=min(stimulus.depth, one.deepest))
                held = poke_place(world, one.place, poke, reflex=answer.without, seed=seed + index)
                acted = poke_place(
                    world, one.place, poke, reflex=capability, seed=seed + index, elsewhere=elsewhere
                )
                yield measure(robot, one.part, one.name, acted, held, answer)


def run_experiment(
    robots: Sequence[Robot],
    reflex: WithdrawalReflex,
    *,
    stimulus: Stimulus | None = None,
    seed: int = 0,
    via: str | None = None,
    progress: Callable[[Trial], None] = lambda trial: None,
) -> Report:
    """Runs every trial on every robot, then compares those robots that have skin on every field.

    Args:
        robots: Descriptions of the robots.
        reflex: Withdrawal reflex of arms.
        stimulus: Motion of the finger. None selects `Stimulus()`.
        seed: Seed of the random delays of the pokes.
        via: Middleware between reflex and robot, as NAME or NAME:ADDRESS, like the argument of `tci serve`.
            With None, the reflex runs in this process.
        progress: Called with each trial when it has ended.
    """
    trials = []
    for robot in robots:
        for trial in trials_of(robot, reflex, stimulus=stimulus or Stimulus(), seed=seed, via=via):
            trials.append(trial)
            progress(trial)
    whole = [robot for robot in robots if _has_every_field(robot, reflex)]
    bodies = [GenericBody(robot) for robot in whole]
    return Report(
        tuple(trials),
        same_stimulus(bodies, reflex.fields),
        same_touch(bodies, reflex, seed=seed),
        tuple(robot.name for robot in whole),
    )


def _has_every_field(robot: Robot, reflex: WithdrawalReflex) -> bool:
    found = touchable(Skin(robot), initial_joints(robot), [field.place for field in reflex.fields])
    return sum(one.site is not None for one in found) == len(SIDES) * len(reflex.fields)
