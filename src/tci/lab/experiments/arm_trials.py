"""Trials with pokes at random points of forearms and upper arms.

In each trial the reflex must move the skin away from the simulated finger.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tci.body.places import Place
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.lab.experiments.answers import AWAY
from tci.lab.experiments.poke import Stimulus, Trace, poke_place
from tci.robot.description import Robot
from tci.simulation.finger import STIFFNESS
from tci.simulation.world import World

FORCES = (0.5, 10.0)
"""Range of the force [N] with which the simulated finger would press an arm that does not move."""
LEFT = 1.0
"""Time [s] after the first contact within which the skin must have left the finger."""
DURATION = 1.2
"""Length [s] of a trial: `LEFT`, after the finger's way to the skin."""


@dataclass(frozen=True, slots=True)
class ArmTrial:
    """Result of one poke of an arm."""

    patch: str
    taxel: int
    force_n: float
    """Force [N] with which the simulated finger would press an arm that does not move."""
    answered: bool
    """True if the reflex commanded this arm and no other part, and the arm's skin moved away from the finger
    by at least 1 mm (`AWAY`)."""
    left: bool
    """True if the reflex answered, and the skin left the finger within `LEFT` of the first contact."""
    towards: bool
    """True if, at any time after the first command, the skin had moved at least 1 mm (`AWAY`) towards the
    finger since this command."""
    reason: str
    """What the reflex said at the end: why the arm did not move, or that the touch has not ended. Empty if it
    said nothing."""


def arm_trials_of(robot: Robot, reflex: WithdrawalReflex, *, count: int, seed: int = 0) -> Iterator[ArmTrial]:
    """Pokes `count` random taxels of the robot's arms with random forces. Each trial starts in the initial
    posture.

    Skips taxels at which the finger has no room, for example between arm and torso.
    """
    world, chance = World(robot, seed=seed), np.random.default_rng(seed)
    taxels = [
        (patch, taxel)
        for patch in robot.skin
        if robot.part(patch.part).kind == "arm" and robot.limb_segment(patch) is not None
        for taxel in range(len(world.surfaces[patch.name].positions))
    ]
    done = 0
    while done < count:
        patch, taxel = taxels[chance.integers(len(taxels))]
        force, surface = float(chance.uniform(*FORCES)), world.surfaces[patch.name]
        place = Place(patch.name, surface.positions[taxel], surface.normals[taxel])
        stimulus = Stimulus(depth=force / STIFFNESS, duration=DURATION)
        try:
            trace = poke_place(world, place, stimulus, reflex=reflex, seed=seed + done)
        except TciError:
            continue
        moved = _moved(trace)
        right = {part for _, part in trace.commanded} == {patch.part}
        answered = bool(right and moved[-1] >= AWAY)
        yield ArmTrial(
            patch.name, taxel, force, answered, answered and _lasted(trace) <= LEFT,
            bool(moved.min() <= -AWAY), "; ".join(trace.notes),
        )  # fmt: skip
        done += 1


def _lasted(trace: Trace) -> float:
    """Time [s] from the first contact to the last one; infinite if it lasts."""
    if trace.contact_lost is None or trace.first_contact is None:
        return np.inf
    return trace.contact_lost - trace.first_contact


def _moved(trace: Trace) -> np.ndarray:
    """Returns the distances (k,) [mm] by which the skin has moved away from the finger, for each of the k
    periods since the first command. Without a command, returns one 0."""
    if not trace.commanded:
        return np.zeros(1)
    away = np.array(trace.away)[np.array(trace.time) >= trace.commanded[0][0]]
    moved: np.ndarray = (away - away[0]) * 1e3
    return moved
