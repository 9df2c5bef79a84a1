"""The nearest point of a triangulated surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array

FLAT = 1e-12
"""A face counts as having no area if the squared sine of the angle at its first corner is at most this
value.
"""


def nearest_on_faces(
    vertices: Array, faces: NDArray[np.intp], points: Array
) -> tuple[NDArray[np.intp], Array, Array]:
    """Finds the nearest face for each of `points` (k, 3).

    Returns the indices (k, 3) of the face's corners in `vertices`, weights (k, 3) and the nearest point (k,
    3). The nearest point is the mean of the corners with these weights. The weights are barycentric: 0..1,
    with sum 1. `vertices` (n, 3) and `points` are given in one common frame. `faces` (f, 3) are indices of
    vertices.
    """
    points = np.asarray(points, dtype=np.float64)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    weights = _inside(a, b, c, points)
    # If the projection lies outside a face, the nearest point is on one of its edges.
    outside = weights.min(axis=2) < 0.0
    distances = np.where(outside, np.inf, _distance2(weights, a, b, c, points))
    for first, second, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        corners = (a, b, c)
        edge = corners[second] - corners[first]
        along = np.einsum("kfi,fi->kf", points[:, None] - corners[first], edge)
        share = np.clip(along / np.einsum("fi,fi->f", edge, edge), 0.0, 1.0)
        candidate = np.empty_like(weights)
        candidate[..., first], candidate[..., second], candidate[..., third] = 1.0 - share, share, 0.0
        distance = _distance2(candidate, a, b, c, points)
        closer = outside & (distance < distances)
        distances = np.where(closer, distance, distances)
        weights = np.where(closer[..., None], candidate, weights)
    best = distances.argmin(axis=1)
    chosen = weights[np.arange(len(points)), best]
    corners_of_best = faces[best]
    return corners_of_best, chosen, np.einsum("kc,kci->ki", chosen, vertices[corners_of_best])


def _inside(a: Array, b: Array, c: Array, points: Array) -> Array:
    """Projects each of k points onto the plane of each of f faces, and returns the barycentric weights (k, f,
    3) of the projections (Ericson 2004). `a`, `b` and `c` (f, 3) are the corners of the faces. A projection
    outside the face has a negative weight."""
    u, v = b - a, c - a
    w = points[:, None] - a
    uu, uv, vv = (np.einsum("fi,fi->f", *pair) for pair in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("kfi,fi->kf", w, u), np.einsum("kfi,fi->kf", w, v)
    determinant = uu * vv - uv * uv
    flat = determinant <= FLAT * uu * vv
    safe = np.where(flat, 1.0, determinant)
    second = (vv * wu - uv * wv) / safe
    third = (uu * wv - uv * wu) / safe
    # A face without area is treated as its edges.
    second, third = np.where(flat, -1.0, second), np.where(flat, -1.0, third)
    return np.stack([1.0 - second - third, second, third], axis=2)


def _distance2(weights: Array, a: Array, b: Array, c: Array, points: Array) -> Array:
    """Returns the squared distance (k, f) [m2] of each of k points from a point of each of f faces. The
    `weights` (k, f, 3) of the corners `a`, `b` and `c` (f, 3) [m] give the point of the face."""
    there = weights[..., :1] * a + weights[..., 1:2] * b + weights[..., 2:] * c
    offset = points[:, None] - there
    result: Array = np.einsum("kfi,kfi->kf", offset, offset)
    return result
