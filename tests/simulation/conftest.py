"""Simulated worlds that tests share, because building a world takes longer than most tests. Each test gets a
world after a reset."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tci.robot.catalogue import load_robot
from tci.simulation.world import World

ROBOTS = ("nao", "icub")


@pytest.fixture(scope="session")
def worlds() -> dict[str, World]:
    """Returns a world of each packaged robot."""
    return {name: World(load_robot(name)) for name in ROBOTS}


@pytest.fixture(params=ROBOTS)
def world(request: pytest.FixtureRequest, worlds: dict[str, World]) -> Iterator[World]:
    """Returns the worlds of the robots, one robot per test."""
    found = worlds[request.param]
    found.reset()
    yield found
    found.reset()


@pytest.fixture
def nao(worlds: dict[str, World]) -> World:
    """Returns the world of the NAO."""
    worlds["nao"].reset()
    return worlds["nao"]
