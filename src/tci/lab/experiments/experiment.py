"""Trials of `tci demo`: one poke for every robot, side and receptive field; then two comparisons of the
robots, with the same contact (`same_stimulus`) and with the same pressure (`same_touch`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

from tci.body.generic_body import GenericBody
from tci.body.touchable import Touchable, touchable
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.measure import Trial, measure
from tci.lab.experiments.poke import Stimulus, poke_place
from tci.lab.experiments.remote_trial import RemoteTrial
from tci.lab.experiments.same_stimulus import SameStimulus, initial_joints, same_stimulus
from tci.lab.experiments.same_touch import SameTouch, same_touch
from tci.robot.description import Robot
from tci.simulation.poke_first import poke_first
from tci.simulation.world import World
from tci.skin.skin import Skin

SIDES = ("left", "right")


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
) -> Iterator[Trial]:
    """Pokes the centre of every receptive field of `reflex` on the arms of one robot, with and without the
    reflex, or what else the robot can feel with (`trial_places`).

    In the trials without the reflex, the arms keep their posture in the control mode of `reflex`. If `via`
    names a middleware, the reflex runs in another process and reaches the robot through this middleware.
    """
    nothing = replace(reflex, fields=())
    world = World(robot, seed=seed)
    with RemoteTrial(robot, via, reflex) if via else nullcontext() as elsewhere:
        for index, one in enumerate(trial_places(robot, reflex, sides)):
            name = one.place.patch if one.site is None else reflex.fields[one.site].name
            if one.site is None and not _has_room(world, one):
                continue
            own = seed + index
            held = poke_place(world, one.place, stimulus, reflex=nothing, seed=own)
            acted = poke_place(world, one.place, stimulus, reflex=reflex, seed=own, elsewhere=elsewhere)
            yield measure(robot, one.part, name, acted, held)


def trial_places(robot: Robot, reflex: WithdrawalReflex, sides: Sequence[str] = SIDES) -> list[Touchable]:
    """Where `trials_of` pokes: the fields' centres that have skin, or on a robot without any the middle of
    each patch."""
    joints = initial_joints(robot)
    found = [*touchable(Skin(robot), joints, [field.place for field in reflex.fields])]
    arms = [one for one in found if one.site is not None and robot.part(one.part).side in sides]
    return arms or [one for one in found if one.site is None]


def _has_room(world: World, one: Touchable) -> bool:
    world.reset()
    found = poke_first(world, [one], speed=1.0, depth=0.0)
    world.finger.retire()
    return found is not None


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
    whole = [robot for robot in robots if len(trial_places(robot, reflex)) == len(SIDES) * len(reflex.fields)]
    bodies = [GenericBody(robot) for robot in whole]
    return Report(
        tuple(trials),
        same_stimulus(bodies, reflex.fields),
        same_touch(bodies, reflex, seed=seed),
        tuple(robot.name for robot in whole),
    )
