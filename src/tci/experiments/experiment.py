"""All trials of the demo: every robot, side and site; then the same stimulus on all robots."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.experiments.measure import Trial, measure
from tci.experiments.poke import Stimulus, poke
from tci.experiments.remote_trial import RemoteTrial
from tci.experiments.same_stimulus import SameStimulus, same_stimulus
from tci.robot.description import Robot
from tci.simulation.world import World

SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class Report:
    """What `report.json` holds."""

    trials: tuple[Trial, ...]
    same_stimulus: SameStimulus

    def to_json(self) -> dict[str, Any]:
        """As a dictionary of plain values."""
        return asdict(self)


def trials_of(
    robot: Robot, reflex: WithdrawalReflex, *, stimulus: Stimulus, seed: int, via: str | None = None
) -> Iterator[Trial]:
    """Poke the centre of every field of `reflex`, on both arms of one robot, with the reflex and without.

    Without it the arms are in the same control mode and hold their posture. With `via` the reflex, which
    must have its usual fields, is in another process that reaches the robot through that middleware.
    """
    nothing = replace(reflex, fields=())
    world = World(robot, seed=seed)
    with RemoteTrial(robot, via, reflex.mode) if via else nullcontext() as elsewhere:
        for index, (side, site) in enumerate((side, site) for side in SIDES for site in reflex.fields):
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
    """Run every trial on every robot, telling `progress` after each, then compare the robots.

    `via` as `trials_of` takes it.
    """
    trials = []
    for robot in robots:
        for trial in trials_of(robot, reflex, stimulus=stimulus or Stimulus(), seed=seed, via=via):
            trials.append(trial)
            progress(trial)
    return Report(tuple(trials), same_stimulus([GenericBody(robot) for robot in robots], reflex.fields))
