"""The reflex in many worlds answers as in worlds that are stepped alone."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import tci.batch
from helpers.rested import rested
from tci.batch import Answers, MujocoWorlds
from tci.batch.limiter import BatchLimiter
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import PlatformCommand, Reading
from tci.simulation.world import World

STEP, PERIOD, SECONDS, TAXELS = 0.002, 0.02, 5.0, (60, 100, 150, 200)


@pytest.mark.parametrize("name", ["nao", "icub", "g1"])
def test_reflexes_begin_and_end_as_in_single_worlds(name: str) -> None:
    scene = tci.batch.batch_scene(name, step=STEP, period=PERIOD)
    worlds = MujocoWorlds(scene, len(TAXELS), threads=1)
    # Not a multiple of the period: the two clocks differ by their rounding.
    reflex, servos = WithdrawalReflex(refractory=0.51), len(scene.robot.servos)
    answers = Answers(worlds, reflex)
    first = worlds.joints[:1].copy()
    alone = [World(name, step=STEP, period=PERIOD) for _ in TAXELS]
    perceivers = [rested(scene) for _ in TAXELS]
    memories: list[Any] = [reflex.init(scene.body) for _ in TAXELS]
    limiters = [BatchLimiter(scene.limits, first, period=PERIOD) for _ in TAXELS]
    wanted, begun = np.full((len(TAXELS), servos), np.nan), 0
    for tick in range(round(SECONDS / PERIOD)):
        if tick in (2, 120):  # the second poke comes after the refractory time
            worlds.advance(tick * PERIOD - worlds.time)
            for w, taxel in enumerate(TAXELS):
                worlds.poke("left_forearm", taxel, worlds=[w], speed=0.25)
                alone[w].finger.poke("left_forearm", taxel, speed=0.25)
        worlds.advance(tick * PERIOD + STEP - worlds.time)
        answers.step()
        for w, one in enumerate(alone):
            joints = dataclasses.replace(one.joints(), stamp=10.0 + one.time)
            frames = tuple(
                dataclasses.replace(f, stamp=10.0 + f.stamp, sequence=1000 + f.sequence) for f in one.frames()
            )
            perception = perceivers[w].step(Reading(joints, frames), joints.stamp)
            orders, memories[w] = reflex.step(memories[w], perception, scene.body)
            for order in scene.body.to_platform(orders, joints)[0]:
                assert isinstance(order, PlatformCommand)
                wanted[w, order.servos] = order.values
            one.advance(tick * PERIOD + STEP)  # a target is sent one step after the frame
            one.set_position_targets(np.arange(servos), limiters[w].step(wanted[w : w + 1])[0])
            mine, its = answers.memories[w], memories[w]
            assert {*mine} == {*its}
            for part in its:
                assert mine[part].started == pytest.approx(its[part].started - 10.0, abs=1e-9)
                assert np.abs(mine[part].target - its[part].target).max() <= 1e-6
                begun += its[part].started == perception.stamp
            one.advance((tick + 1) * PERIOD)
    assert begun >= 2 * len(TAXELS)
