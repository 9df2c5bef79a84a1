"""The angles of limbs in many worlds are those of a single body."""

from __future__ import annotations

import numpy as np
import pytest

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
