"""Distances between points of a skin.

For a few points, NumPy computes all distances. For more points SciPy's k-d tree is faster, but the import of
SciPy takes 0.2 s, a fifth of the time in which a program starts. So SciPy is imported only for skins with
many taxels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array

MOST = 1_000_000
"""Largest number of distances that are computed without a k-d tree. Assumed: this computation takes at most
10 ms, which is short compared with the import of SciPy."""


def nearest(points: Array, queries: Array, count: int = 1) -> tuple[Array, NDArray[np.intp]]:
    """Finds, for each of `queries` (k, 3) [m], the `count` nearest of `points` (n, 3) [m].

    Returns the distances (k, count) [m] and the indices (k, count) of these points, the nearest point first.
    `count` must be at most n.
    """
    if _few(points, queries):
        apart = _distances(queries, points)
        found = np.argpartition(apart, count - 1, axis=1)[:, :count]
        near = np.take_along_axis(apart, found, axis=1)
        order = near.argsort(axis=1)
        return np.take_along_axis(near, order, axis=1), np.take_along_axis(found, order, axis=1)
    distances, indices = _tree(points).query(queries, k=[*range(1, count + 1)])
    return distances, indices


def pairs_within(points: Array, reach: float) -> NDArray[np.intp]:
    """Returns pairs (m, 2) of the indices of `points` (n, 3) [m] that are at most `reach` [m] apart, each
    pair once."""
    if _few(points, points):
        return np.argwhere(np.triu(_distances(points, points) <= reach, k=1))
    found: NDArray[np.intp] = _tree(points).query_pairs(reach, output_type="ndarray").astype(np.intp)
    return found


def number_within(points: Array, reach: float) -> NDArray[np.intp]:
    """Counts, for each of `points` (n, 3) [m], the points that are at most `reach` [m] away. Returns these
    numbers (n,). The point itself is counted too."""
    if _few(points, points):
        return np.asarray((_distances(points, points) <= reach).sum(axis=1))
    return np.asarray(_tree(points).query_ball_point(points, reach, return_length=True))


def distances_within(
    points: Array, others: Array, reach: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Finds the pairs of `points` (n, 3) [m] and `others` (k, 3) [m] that are at most `reach` [m] apart.

    Returns for each pair the index (m,) in `points`, the index (m,) in `others`, and the distance (m,) [m].
    """
    if _few(points, others):
        apart = _distances(points, others)
        one, other = np.nonzero(apart <= reach)
        return one, other, apart[one, other]
    found = _tree(points).sparse_distance_matrix(_tree(others), reach, output_type="ndarray")
    return found["i"], found["j"], found["v"]


def _few(points: Array, others: Array) -> bool:
    return len(points) * len(others) <= MOST


def _distances(points: Array, others: Array) -> Array:
    """Returns the distances (n, k) [m] of all `points` (n, 3) [m] from all `others` (k, 3) [m]. Raises
    ValueError for coordinates that are not finite."""
    x, y, z = (points.T[:, :, None] - others.T[:, None]) ** 2
    result: Array = np.sqrt(x + y + z)
    if not np.isfinite(result).all():
        raise ValueError("all coordinates must be finite")
    return result


def _tree(points: Array) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(points)
