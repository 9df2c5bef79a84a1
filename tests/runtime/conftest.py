"""A simulated NAO without skin, for tests of the loop."""

from __future__ import annotations

import pytest

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.simulation.world import World


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"), skin=False)


@pytest.fixture
def driver(world: World) -> SimulatedDriver:
    world.reset()
    return SimulatedDriver(world.robot, world=world)
