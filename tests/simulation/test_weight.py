"""A robot on a fixed base that has weight: servos hold it, and what they do not hold hangs."""

from __future__ import annotations

import numpy as np
import pytest

from tci.messages import Mode
from tci.robot.gravity import Gravity
from tci.simulation.world import World

ARM = ("LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll")


@pytest.fixture(scope="module")
def world() -> World:
    return World("nao", skin=False, weight=True)


def moved(world: World, *, mode: Mode = Mode.POSITION, power: bool = True, carried: float = 0.0) -> float:
    """Largest way [rad] of the left arm's joints in 0.3 s; in torque mode with a share of the torques that
    carry the weight."""
    world.reset()
    arm = np.array([one.index for one in world.robot.servos if one.name in ARM])
    before = world.joints().position
    world.set_modes(arm, [mode] * len(arm))
    if not power:
        world.set_power(arm, False)
    gravity = Gravity(world.robot)
    for tick in range(1, 61):
        if mode is Mode.TORQUE:
            world.set_torques(arm, carried * gravity.torques(world.joints().position)[arm])
        world.advance(0.005 * tick)
    return float(np.abs(world.joints().position - before)[arm].max())


def test_servos_hold_the_weight_and_what_is_limp_hangs(world: World) -> None:
    for mode in (Mode.POSITION, Mode.IMPEDANCE):
        assert moved(world, mode=mode) < 1e-6
    assert moved(world, power=False) > 0.3
    assert moved(world, mode=Mode.TORQUE) > 0.3
    assert moved(world, mode=Mode.TORQUE, carried=1.0) < 0.02
    assert moved(World("nao", skin=False), mode=Mode.TORQUE) == 0.0
