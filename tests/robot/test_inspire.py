"""A G1 with the pads of two Inspire hands."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from tci.body import GenericBody, Perceiver
from tci.capabilities import BodyWithdrawal
from tci.drivers.simulated import SimulatedDriver
from tci.messages import Reading
from tci.robot.catalogue import load_robot
from tci.robot.description import Grid
from tci.simulation.world import World
from tci.skin.surfaces import surfaces_of

HAND = Counter({(3, 3): 6, (12, 8): 6, (10, 8): 4, (8, 14): 1})
"""Rows and columns of the 17 pads of one hand (Inspire's manual): 1062 taxels."""
PALM = {0: (7, 0), 1: (6, 0), 8: (7, 1), 111: (0, 13)}
"""Row and column, from 0, of values of the palm, which is read column by column from the last row on."""


def test_rows_columns_and_order_are_those_of_the_manual() -> None:
    robot = load_robot("g1-inspire")
    assert sum(patch.channels for patch in robot.patches) == 2124
    shapes: dict[str, Counter[tuple[int, int]]] = {"left": Counter(), "right": Counter()}
    for patch in robot.patches:
        assert isinstance(patch.surface, Grid)
        shapes[patch.name.partition("_")[0]][patch.surface.rows, patch.surface.columns] += 1
        assert not patch.assumed
    assert shapes == {"left": HAND, "right": HAND}
    surfaces = {surface.patch: surface for surface in surfaces_of(robot)}
    for name in ("left_palm", "right_palm"):
        places = surfaces[name].positions
        # Rows are 30 mm / 8 apart, columns 50 mm / 14, so two values tell both directions.
        down, across = places[1] - places[0], places[8] - places[0]
        assert np.linalg.norm(down) < 0.0039
        assert np.linalg.norm(across) < 0.0037
        origin = places[0] - 7 * -down
        for value, (row, column) in PALM.items():
            np.testing.assert_allclose(places[value], origin - row * down + column * across, atol=1e-6)
    for name in ("left_index_top", "right_index_top"):  # row by row: 8 values across the finger
        places = surfaces[name].positions
        assert np.linalg.norm(places[8] - places[0]) < 0.0014
        assert np.linalg.norm(places[7] - places[0]) > 0.009


def readings(name: str, touched: str) -> list[Reading]:
    robot = load_robot(name)
    world = World(robot)
    driver = SimulatedDriver(robot, world=world)
    world.finger.poke(touched, len(world.surfaces[touched].positions) // 2, depth=0.004, speed=0.1)
    found = []
    for _ in range(500):
        found.append(driver.read())
        world.advance(world.time + driver.period)
    return found


def test_2124_taxels_cost_at_most_half_as_much_again_as_a_g1_in_sleeves() -> None:
    """Processor time from frame to command, both robots in turns, and both touched."""
    cases = {"g1": readings("g1", "left_forearm"), "g1-inspire": readings("g1-inspire", "left_palm")}
    spent: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(5):
        for name, given in cases.items():
            body, reflex = GenericBody(load_robot(name)), BodyWithdrawal(stance="supported")
            perceiver, memory = Perceiver(body), reflex.init(body)
            touches = 0
            begin = time.thread_time()
            for reading in given:
                perception = perceiver.step(reading, reading.joints.stamp)
                touches += len(perception.contacts)
                _, memory = reflex.step(memory, perception, body)
            spent[name].append(time.thread_time() - begin)
            assert touches > 100
    assert min(spent["g1-inspire"]) <= 1.5 * min(spent["g1"])
