"""What a perceiver knows of a simulated skin after a second without touch."""

from __future__ import annotations

import dataclasses

from tci.batch import BatchScene
from tci.body.perceiver import Perceiver
from tci.messages import Reading
from tci.simulation.world import World


def rested(scene: BatchScene) -> Perceiver:
    one, perceiver = World(scene.robot, step=scene.step), Perceiver(scene.body)
    for k in range(110):
        joints = dataclasses.replace(one.joints(), stamp=0.01 * k)
        frames = tuple(dataclasses.replace(f, stamp=0.01 * k, sequence=k) for f in one.frames())
        perceiver.step(Reading(joints, frames), joints.stamp)
    return perceiver
