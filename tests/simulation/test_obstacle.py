"""What lies around a robot: links collide with it and skin feels it, also the robot's own other arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tci.errors import CommandError, UnknownNameError
from tci.messages.frames import Array
from tci.simulation import Meeting, Obstacle
from tci.simulation.world import World

STIFF, SOFT = 20e3, 4e3


@pytest.fixture(scope="module")
def world() -> World:
    return World(
        "nao",
        obstacles=[
            Obstacle(name="hard", stiffness=STIFF, radius=0.03),
            Obstacle(name="soft", stiffness=SOFT, radius=0.02, half=0.05),
            Obstacle(name="light", stiffness=STIFF, radius=0.03, mass=0.5),
            Obstacle(name="table", stiffness=100e3, box=(0.1, 0.1, 0.02)),
        ],
    )


def swing(world: World, targets: Array, duration: float) -> Iterator[tuple[Meeting, ...]]:
    """Moves all servos in a straight line, and gives what touches every 10 ms."""
    here, begin = world.joints().position, world.time
    for part in np.arange(0.01, duration, 0.01) / duration:
        world.set_position_targets(np.arange(len(here)), here + part * (targets - here))
        world.advance(begin + part * duration)
        yield world.meetings()


def strike(world: World, name: str, seed: int) -> tuple[float, float, str]:
    """Lets the left arm strike an obstacle beside a random taxel: the largest force, the force that skin felt
    at this time, and what was struck."""
    random = np.random.default_rng(seed)
    patch = str(random.choice(["left_forearm", "left_upper_arm"]))
    taxel = int(random.integers(len(world.surfaces[patch].positions)))
    world.reset()
    home = world.joints().position
    point, normal = world.skin_point(patch, taxel)
    world.obstacle(name).place(point + 0.06 * normal)
    arm = [servo.index for servo in world.robot.servos if servo.name.startswith(("LShoulder", "LElbow"))]
    targets = home.copy()
    targets[arm] += random.uniform(-0.8, 0.8, len(arm))
    best = (0.0, 0.0, "")
    for met in swing(world, targets, 0.6):
        mine = [one for one in met if name in (one.first, one.second)]
        force = sum(one.force for one in mine)
        if force > best[0]:
            felt = sum(world.contact_truth(one).force for one in world.surfaces)
            best = (force, felt, " ".join(sorted({one.first for one in mine} | {one.second for one in mine})))
    return best


def test_an_arm_that_strikes_something_is_held_and_its_skin_feels_it(world: World) -> None:
    struck = [strike(world, name, seed) for name in ("hard", "soft", "table") for seed in range(12)]
    hits = [one for one in struck if one[0] > 2.0]
    assert len(hits) >= 5
    on_skin = [one for one in hits if "left_" in one[2]]
    assert on_skin
    for force, felt, what in on_skin:
        if set(what.split()) <= {"hard", "soft", "table", "left_forearm", "left_upper_arm"}:
            assert felt == pytest.approx(force, rel=0.02), what


def test_what_can_give_way_goes_away(world: World) -> None:
    gone = 0
    for seed in range(12):
        force, _, _ = strike(world, "light", seed)
        if force > 1.0:
            world.advance(world.time + 0.3)
            held = [one for one in world.meetings() if "light" in (one.first, one.second)]
            assert sum(one.force for one in held) < 1.0
            gone += 1
    assert gone >= 2


def test_the_skin_of_an_arm_feels_the_other_arm(world: World) -> None:
    random = np.random.default_rng(4)
    servos = world.robot.servos
    arms = [one.index for one in servos if one.name[1:].startswith(("Shoulder", "Elbow"))]
    for _ in range(40):
        world.reset()
        targets = world.joints().position.copy()
        for index in arms:
            limits = servos[index].limits
            assert limits.lower is not None
            assert limits.upper is not None
            targets[index] = random.uniform(limits.lower, limits.upper)
        for met in swing(world, targets, 1.0):
            for one in met:
                pair = sorted((one.first, one.second))
                sides = [name[0].upper() for name in pair]
                if one.first in world.surfaces and one.force > 2.0 and sides == ["L", "R"]:
                    truth = world.contact_truth(one.first)
                    assert truth.force >= 0.99 * one.force
                    return
    pytest.fail("the arms never met")


def test_a_wrong_obstacle_says_what_is_valid(world: World) -> None:
    for change in ({"stiffness": 1.0}, {"mass": 0.0}, {"radius": -1.0}, {"box": (0.0, 1.0, 1.0)}):
        with pytest.raises(CommandError, match="valid"):
            Obstacle(**{"name": "thing", "stiffness": 1e3, **change})  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="table"):
        world.obstacle("chair")
