"""Imperfect skin of many worlds does what its settings say."""

from __future__ import annotations

import numpy as np
import pytest

import tci.batch
from tci.batch import Imperfections, ImperfectSkin, MujocoWorlds
from tci.errors import TciError
from tci.messages.frames import Array


class Given:
    """Worlds whose forces are as a test says."""

    def __init__(self, worlds: MujocoWorlds) -> None:
        self.scene, self.count, self.ids, self.time = worlds.scene, worlds.count, worlds.ids, 0.0
        self.force: Array = np.zeros((worlds.count, worlds.scene.taxels))


@pytest.fixture
def worlds() -> Given:
    return Given(tci.batch.make_worlds("nao", 8, threads=1))


def skin(worlds: Given, **settings: object) -> ImperfectSkin:
    return ImperfectSkin(worlds, Imperfections(**settings))  # type: ignore[arg-type]


def test_without_imperfections_forces_are_read_as_they_are(worlds: Given) -> None:
    worlds.force[2, 30] = 3.0
    np.testing.assert_array_equal(skin(worlds).read(), worlds.force)


def test_gains_and_dead_taxels_are_drawn_anew_for_each_world(worlds: Given) -> None:
    worlds.force[:] = 1.0
    one = skin(
        worlds,
        probe_gain_resample_range=(0.8, 1.2),
        dead_taxel_probability=0.1,
        dead_taxel_value_range=(5.0, 6.0),
    )
    first = one.read()
    gone = first >= 5.0
    assert 0.05 < gone.mean() < 0.15
    assert (first[~gone] >= 0.8).all()
    assert (first[~gone] <= 1.2).all()
    assert first[~gone].std() > 0.1
    assert not np.array_equal(first[0], first[1])
    one.reset([3])
    second = one.read()
    assert np.flatnonzero((first != second).any(axis=1)).tolist() == [3]


def test_neighbours_share_the_cross_talk(worlds: Given) -> None:
    patch = worlds.scene.world.surfaces["left_forearm"]
    begin = int(worlds.scene.body.layout.starts[worlds.scene.body.layout.places["left_forearm"]])
    around = {int(b if a == 100 else a) for a, b in patch.neighbours.tolist() if 100 in (a, b)}
    worlds.force[0, begin + 100] = 2.0
    found = skin(worlds, crosstalk_strength=0.1).read()[0] - worlds.force[0]
    assert {int(k) - begin for k in np.flatnonzero(found)} == around
    np.testing.assert_allclose(found[found > 0.0], 0.2 / len(around))


def test_hysteresis_creep_and_delay(worlds: Given) -> None:
    slow, soft, late = (
        skin(worlds, hysteresis=0.2),
        skin(worlds, creep=0.1, creep_time=1.0),
        skin(worlds, delay=0.05),
    )
    seen = []
    for k in range(400):
        worlds.time, worlds.force[0, 7] = 0.01 * k, 4.0 if k < 300 else 1.0
        seen.append([one.read()[0, 7] for one in (slow, soft, late)])
    hysteresis, creep, delay = np.array(seen).T
    assert hysteresis[299] == 4.0
    assert hysteresis[300] == pytest.approx(1.0 + 0.2 * 3.0)
    assert creep[299] == pytest.approx(4.0 * (1.0 + 0.1 * (1.0 - np.exp(-2.99))))
    assert delay[:5].tolist() == [0.0] * 5
    assert delay[5:305].tolist() == [4.0] * 300
    assert delay[305] == 1.0


def test_what_is_valid_is_said() -> None:
    with pytest.raises(TciError, match=r"dead_taxel_probability 2\.0; valid: 0 to 1"):
        Imperfections(dead_taxel_probability=2.0)
