"""Trials of `tci demo`: one poke for every robot, side and receptive field; then two comparisons of the
robots, with the same contact (`same_stimulus`) and with the same pressure (`same_touch`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.measure import Trial, measure
from tci.lab.experiments.poke import Stimulus, poke
from tci.lab.experiments.remote_trial import RemoteTrial
from tci.lab.experiments.same_stimulus import SameStimulus, same_stimulus
from tci.lab.experiments.same_touch import SameTouch, same_touch
from tci.robot.description import Robot
from tci.simulation.world import World

SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class Report:
    """Contents of the file `report.json`."""

    trials: tuple[Trial, ...]
    same_stimulus: SameStimulus
    same_touch: tuple[SameTouch, ...]

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
) -> Iterator[Trial]:
    """Pokes the centre of every receptive field of `reflex` on the arms of one robot, with and without the
    reflex.

    In the trials without the reflex, the arms keep their posture in the control mode of `reflex`. If `via`
    names a middleware, the reflex runs in another process and reaches the robot through this middleware.
    """
    nothing = replace(reflex, fields=())
    world = World(robot, seed=seed)
    with RemoteTrial(robot, via, reflex) if via else nullcontext() as elsewhere:
        for index, (side, site) in enumerate((side, site) for side in sides for site in reflex.fields):
            part = f"{side}_arm"
            held = poke(world, part, site, stimulus, reflex=nothing, seed=seed + index)
            acted = poke(world, part, site, stimulus, reflex=reflex, seed=seed + index, elsewhere=elsewhere)
            yield measure(robot, part, site.name, acted, held)


def run_experiment(
    robots: Sequence[Robot],
    reflex: WithdrawalReflex,
    *,
    stimulus: Stimulus | None = None,
    seed: int = 0,
    via: str | None = None,
    progress: Callable[[Trial], None] = lambda trial: None,
) -> Report:
    """Runs every trial on every robot, then compares the results of the robots.

    Args: robots: Descriptions of the robots. reflex: Withdrawal reflex of arms. stimulus: Motion of the
        finger. None selects `Stimulus()`. seed: Seed of the random delays of the pokes. via: Middleware
        between reflex and robot, as NAME or NAME:ADDRESS, like the argument of `tci serve`. With None, the
        reflex runs in this process. progress: Function that is called with each trial when the trial has
        ended.
    """
    trials = []
    for robot in robots:
        for trial in trials_of(robot, reflex, stimulus=stimulus or Stimulus(), seed=seed, via=via):
            trials.append(trial)
            progress(trial)
    bodies = [GenericBody(robot) for robot in robots]
    return Report(tuple(trials), same_stimulus(bodies, reflex.fields), same_touch(bodies, reflex, seed=seed))
