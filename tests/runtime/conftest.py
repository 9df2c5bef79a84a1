"""A simulated NAO without skin, for tests of the loop."""

from __future__ import annotations

import pytest

import tci
from tci.drivers.simulated import SimulatedLink
from tci.simulation.world import World


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"), skin=False)


@pytest.fixture
def link(world: World) -> SimulatedLink:
    world.reset()
    return SimulatedLink(world.robot, world=world)
