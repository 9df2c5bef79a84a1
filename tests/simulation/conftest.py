"""Worlds that tests share, since building one takes longer than most tests. A test gets a reset one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tci.robot.catalogue import load_robot
from tci.simulation.world import World

ROBOTS = ("nao", "icub")


@pytest.fixture(scope="session")
def worlds() -> dict[str, World]:
    """A world of each packaged robot."""
    return {name: World(load_robot(name)) for name in ROBOTS}


@pytest.fixture(params=ROBOTS)
def world(request: pytest.FixtureRequest, worlds: dict[str, World]) -> Iterator[World]:
    """Each robot's world in turn."""
    found = worlds[request.param]
    found.reset()
    yield found
    found.reset()


@pytest.fixture
def nao(worlds: dict[str, World]) -> World:
    """The NAO's world."""
    worlds["nao"].reset()
    return worlds["nao"]
