"""What many worlds share: MuJoCo's model, and the tables of servos, finger, skin and contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.errors import TciError
from tci.gate.bounds import bounds_of
from tci.gate.settings import GateSettings
from tci.messages.frames import Array, frozen
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot
from tci.simulation.world import World
from tci.skin.conditioning import Conditioner
from tci.skin.kernels.arrays import Estimates
from tci.support.engine import mujoco

RESTED = 1.0
"""Time [s] without touch after which the rest values and the noise of all taxels are known."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchScene:
    """What many worlds of one robot share."""

    robot: Robot
    body: GenericBody
    model: mujoco.MjModel
    world: World
    """One world, from which all tables come; it stays at its start."""
    estimates: Estimates
    """Of the skin at rest."""
    limits: Array
    """Lowest and highest angles [rad], speeds [rad/s], accelerations [rad/s2] and jerks [rad/s3] (5, n) of
    all servos, as the gate permits them; zeros for a servo whose limits are not known."""
    period: float
    """Time [s] between two targets of the servos."""
    torso: int
    """Body that carries the torso frame."""
    T_LT: Array
    """Pose (4, 4) of the torso frame in it."""
    bodies: NDArray[np.int64]
    """Bodies (l,) of the links in `SkinLayout.links`."""

    @property
    def step(self) -> float:
        return self.world.step

    @property
    def taxels(self) -> int:
        return len(self.body.layout.arrays.taxels)


def batch_scene(robot: RobotLike, *, step: float = 0.002, **world: Any) -> BatchScene:
    """The scene of `World(robot, step=step, **world)`, taken as it is.

    Raises TciError for a robot whose skin is felt through joint torques, and for people, obstacles, weight,
    standing, noise and imperfections, which batches do not have.
    """
    robot = as_robot(robot)
    if joints := [one.name for one in robot.patches if one.through_joints]:
        raise TciError(f"{joints[0]} of {robot.name} feels through joint torques; valid: skin with taxels")
    if unknown := sorted({*world} - {"posture", "tip", "period"}):
        raise TciError(f"a batch with {unknown[0]!r}; valid: step, posture, tip, period")
    one, body = World(robot, step=step, **world), GenericBody(robot)
    period = one.servos.ramp_steps * one.step
    bounds, _ = bounds_of(robot, range(len(robot.servos)), speed_share=GateSettings().speed_share)
    limits = np.array([bounds.lower, bounds.upper, bounds.velocity, bounds.acceleration, bounds.jerk])
    model = robot.model
    assert model is not None  # or there was no world
    return BatchScene(
        robot=robot,
        body=body,
        model=one.model,
        world=one,
        estimates=_rested(one, body),
        limits=frozen(np.where(np.isfinite(limits).all(axis=0), limits, 0.0)),
        period=period,
        torso=one.model.body(model.torso_link).id,
        T_LT=frozen(np.array(model.T_LT)),
        bodies=frozen(np.array([one.model.body(link).id for link in body.layout.links], np.int64)),
    )


def _rested(world: World, body: GenericBody) -> Estimates:
    """What is known of the skin after a second without touch."""
    conditioner = Conditioner(body.layout, body.settings.conditioning)
    while world.time < RESTED:
        conditioner.step(world.frames())
        world.advance(world.time + 0.01)
    conditioner.catch_up()
    world.reset()
    return conditioner.estimates
