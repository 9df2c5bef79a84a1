"""The angles of limbs in many worlds are those of a single body."""

from __future__ import annotations

import numpy as np
import pytest

import tci.batch
from tci.batch.cpu import MujocoWorlds
from tci.batch.posture import ANGLES, LimbTables
from tci.body.generic_body import GenericBody
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize("name", ["nao", "icub", "g1", "talos", "alex"])
def test_limbs_of_many_worlds_have_the_generic_angles_of_a_single_body(name: str) -> None:
    body, chance = GenericBody(load_robot(name)), np.random.default_rng(7)
    tables, worlds = LimbTables(body), np.array([3, 0, 5])
    assert len(body.layout.parts) >= 2
    for _ in range(50):
        angles = chance.uniform(-3.0, 3.0, (3, len(body.robot.servos)))
        posture = np.zeros((6, len(tables.limbs), ANGLES))
        tables.fill(angles, worlds, posture)
        for w, own in zip(worlds, angles, strict=True):
            for row, part in enumerate(body.layout.parts):
                expected = body.joint_maps[part].to_generic(own)[:ANGLES]
                np.testing.assert_allclose(posture[w, row], expected, rtol=0.0, atol=1e-12)
        assert not posture[[1, 2, 4]].any()


def test_limbs_with_tables_are_placed_as_those_without() -> None:
    plain, tabled = (tci.batch.make_worlds("nao", 3, threads=1) for _ in range(2))
    assert isinstance(tabled, MujocoWorlds)
    body, limbs = tabled.scene.body, tabled._limbs
    for row, part in enumerate(body.layout.parts):
        limbs.tabled.append((row, body.joint_maps[part]))
    limbs.limbs["tabled"], limbs.limbs["offset"], limbs.weights[:] = 1, 9.0, 9.0
    for worlds in (plain, tabled):
        worlds.poke(["left_forearm", "right_upper_arm"], [40, 60], worlds=[0, 2])
        worlds.advance(0.1)
    for w in (0, 2):
        found, expected = tabled.contacts(w), plain.contacts(w)
        assert len(found) == len(expected) > 0
        for mine, its in zip(found, expected, strict=True):
            np.testing.assert_allclose([mine.u, mine.theta], [its.u, its.theta], rtol=0.0, atol=1e-9)
    assert not tabled.contacts(1)
