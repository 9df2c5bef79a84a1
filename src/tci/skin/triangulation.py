"""Triangles between the taxels of a skin: of a sheet on a plane, of a limb unrolled around its axis.

All taxels are corners. A convex hull would leave out those in hollows, and would put touches there up to 9 mm
outside the skin of an iCub's forearm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from tci.frames import Array

SHEET = 0.3
"""Least cosine between each normal of a skin and their mean for it to be a sheet: 72 degrees. Assumed; a
limb's normals point all around, a palm's or a sole's stay well within."""
OFF = 1e-3
"""Largest distance [m] of a taxel from its projection. Assumed: the figure that skin files are rounded to."""
TIE = 1e-6
"""Standard deviation [m] of shifts that decide between equally good triangles. Without them those of a
regular lattice differ from one turn of an unrolled limb to the next."""

_NONE = np.zeros((0, 3), np.intp)


def is_sheet(normals: Array) -> bool:
    """Returns True if a skin with these normals (n, 3) is a sheet: a palm, a sole, a cap, a single taxel."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return length > 0.0 and float((normals @ (mean / length)).min()) > SHEET


def triangulate(positions: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) between taxels at `positions` (n, 3) [m] with `normals` (n, 3).

    There are none for taxels on one line, or if their normals leave one of them out by more than OFF.
    """
    places, index = np.unique(positions, axis=0, return_index=True)
    if len(places) < 3 or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6) < 2:
        return _NONE
    make = _on_plane if is_sheet(normals) else _around_axis
    try:
        faces = index[make(places, normals[index])]
    except QhullError:
        return _NONE
    corners = positions[np.unique(faces)]
    whole = len(corners) > 0 and float(cKDTree(corners).query(positions)[0].max()) <= OFF
    return faces if whole else _NONE


def outward(faces: NDArray[np.intp], positions: Array, normals: Array) -> NDArray[np.intp]:
    """Orients triangles anticlockwise, seen from the side that the taxels' normals point to."""
    inward = np.einsum("fi,fi->f", _unit_normals(faces, positions), normals[faces].mean(axis=1)) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _on_plane(places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) of a sheet, seen along the mean of its normals."""
    across = np.linalg.svd(normals.mean(axis=0, keepdims=True))[2][1:]
    return _delaunay(places @ across.T)


def _around_axis(places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) of a limb from its unrolled skin.

    Its axis has the direction in which the normals vary least, and is nearest to the lines along them.
    """
    axes = np.linalg.eigh(np.cov(normals.T))[1].T
    along, flat, out = places @ axes[0], places @ axes[1:].T, normals @ axes[1:].T
    out = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    beside = np.eye(2) - out[:, :, None] * out[:, None, :]
    towards = np.einsum("nij,nj->i", beside, flat)
    from_axis = flat - np.linalg.lstsq(beside.sum(axis=0), towards, rcond=None)[0]
    around = np.arctan2(from_axis[:, 1], from_axis[:, 0])
    turn = 2.0 * np.pi * np.linalg.norm(from_axis, axis=1).mean()
    unrolled = np.column_stack([around / (2.0 * np.pi) * turn, along])
    unrolled += TIE * np.random.default_rng(0).standard_normal(unrolled.shape)
    n = len(places)
    shift = np.array([turn, 0.0])
    faces = _delaunay(np.concatenate([unrolled - shift, unrolled, unrolled + shift]))
    # Each triangle is found once per turn; that whose lowest taxel is on the middle turn is kept.
    lowest = np.take_along_axis(faces, (faces % n).argmin(axis=1)[:, None], axis=1)[:, 0]
    faces = faces[lowest // n == 1] % n
    faces = faces[[len({*face}) == 3 for face in faces.tolist()]]
    return _skin_only(faces, places, normals)


def _skin_only(faces: NDArray[np.intp], places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns the `faces` (f, 3) without those over a limb's open ends, which carry no skin."""
    towards = normals[faces].mean(axis=1)
    across = np.abs(np.einsum("fi,fi->f", _unit_normals(faces, places), towards))
    result: NDArray[np.intp] = faces[across > 0.5 * np.linalg.norm(towards, axis=1)]
    return result


def _delaunay(flat: Array) -> NDArray[np.intp]:
    """Returns Delaunay's triangles (f, 3) of points (n, 2)."""
    return np.asarray(Delaunay(flat).simplices, dtype=np.intp)


def _unit_normals(faces: NDArray[np.intp], positions: Array) -> Array:
    a, b, c = positions[faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    result: Array = np.divide(across, lengths, out=np.zeros_like(across), where=lengths > 0.0)
    return result
