"""Trials with pokes of head, torso, hands and legs. The module `experiment` contains the trials of arms."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.fields import BodyField
from tci.errors import TciError
from tci.lab.experiments.measure import Trial, measure
from tci.lab.experiments.poke import Stimulus, poke_place
from tci.lab.experiments.remote_trial import RemoteTrial
from tci.robot.description import Robot
from tci.simulation.world import World


def answerable(body: GenericBody, field: BodyField) -> list[str]:
    """Returns the parts of a robot that can respond to touches in the receptive field `field`.

    A part can respond if it has skin in the field, and a servo for at least one joint of the field's motion.
    """
    found = []
    for part in body.robot.parts:
        if part.kind != field.kind or not (np.array(field.motion) * body.has_joint(part.name)).any():
            continue
        try:
            body.landmark(part.name, field.landmark)
        except TciError:
            continue
        found.append(part.name)
    return found


def deaf(reflex: BodyWithdrawal) -> BodyWithdrawal:
    """`reflex` without receptive fields: each part keeps its posture, in the same mode."""
    return replace(reflex, fields=reflex.fields.model_copy(update={"field": (), "surround": ()}))


def body_trials_of(
    robot: Robot,
    reflex: BodyWithdrawal,
    *,
    stimulus: Stimulus | None = None,
    seed: int = 0,
    via: str | None = None,
) -> Iterator[Trial]:
    """Pokes the centre of every receptive field in which a part of the robot can respond, with and without
    the reflex.

    Yields one trial for each field and part. `stimulus` is the motion of the finger, by default `Stimulus()`.
    `seed` is the seed of the first trial. The seed of each further trial is larger by 1. If `via` names a
    middleware, the reflex runs in another process and reaches the robot through this middleware. Raises the
    errors of `poke_place`.
    """
    world, body = World(robot, seed=seed), GenericBody(robot)
    stimulus = stimulus or Stimulus()
    with RemoteTrial(robot, via, reflex) if via else nullcontext() as elsewhere:
        for field in reflex.fields.field:
            for part in answerable(body, field):
                place = body.landmark(part, field.landmark)
                held = poke_place(world, place, stimulus, reflex=deaf(reflex), seed=seed)
                acted = poke_place(world, place, stimulus, reflex=reflex, seed=seed, elsewhere=elsewhere)
                yield measure(robot, part, field.name, acted, held)
                seed += 1
