"""Distances between points of a skin are those of SciPy's k-d tree, with few and with many points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tci.robot import near_points
from tci.robot.near_points import distances_within, nearest, number_within, pairs_within

POINTS, OTHERS = np.random.default_rng(0).uniform(-0.1, 0.1, (2, 60, 3))
TREE = cKDTree(POINTS)
REACH = 0.04


@pytest.fixture(params=[0, near_points.MOST], autouse=True, ids=["tree", "all pairs"])
def most(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near_points, "MOST", request.param)


def test_nearest_points_come_with_their_distances_in_order() -> None:
    distances, indices = TREE.query(OTHERS, k=[1, 2, 3])
    found = nearest(POINTS, OTHERS, 3)
    assert np.array_equal(found[0], distances)
    assert np.array_equal(found[1], indices)
    assert nearest(POINTS, OTHERS)[1].shape == (60, 1)


def test_no_queries_and_no_points_find_nothing() -> None:
    none = np.zeros((0, 3))
    assert [len(one) for one in nearest(POINTS, none)] == [0, 0]
    assert len(pairs_within(none, REACH)) == 0


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_coordinates_must_be_finite(wrong: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        nearest(POINTS, np.array([[wrong, 0.0, 0.0]]))


def test_each_pair_is_found_once() -> None:
    pairs = pairs_within(POINTS, REACH)
    assert {tuple(pair) for pair in pairs.tolist()} == TREE.query_pairs(REACH)
    assert len(pairs) == len(TREE.query_pairs(REACH)) > 20


def test_points_within_reach_are_counted_with_the_point_itself() -> None:
    assert np.array_equal(
        number_within(POINTS, REACH), TREE.query_ball_point(POINTS, REACH, return_length=True)
    )


def test_distances_within_reach() -> None:
    one, other, apart = distances_within(POINTS, OTHERS, REACH)
    sparse = TREE.sparse_distance_matrix(cKDTree(OTHERS), REACH)
    assert {(i, j): d for i, j, d in zip(one.tolist(), other.tolist(), apart, strict=True)} == dict(
        sparse.items()
    )
