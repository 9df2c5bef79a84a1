"""Triangles between the taxels of a skin.

The triangles of a sheet are computed on a plane, and the triangles of a limb on its unrolled surface. All
taxels are corners. A convex hull would leave out taxels in hollows. With a convex hull, the computed place of
a touch in a hollow of an iCub's forearm would be up to 9 mm outside the skin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.near_points import nearest

SHEET = 0.3
"""Least cosine of the angle between each normal of a sheet and the mean of its normals: the angle is at most
72 degrees. Assumed: all normals of a palm or a sole are well within this angle, but normals of a limb point
in all directions around the limb."""
OFF = 1e-3
"""Largest distance [m] of a taxel from the nearest corner of a triangle. If a taxel is farther away,
`triangulate` returns no triangles. Assumed: the rounding of positions in skin files causes smaller distances.
"""
TIE = 1e-6
"""Standard deviation [m] of the small random shifts of taxels that decide between equally good triangles. The
unrolled skin of a limb is copied to both of its sides. Without these shifts, the triangles of a regular
lattice would differ between these copies."""

FLAT = 1e-9
"""Three taxels count as being on one line if twice the area of their triangle is at most this fraction of the
square of the longer edge at the first taxel. Assumed: rounding errors are smaller."""

_NONE = np.zeros((0, 3), np.intp)


def is_sheet(normals: Array) -> bool:
    """Returns True if a skin with these normals (n, 3) is a sheet (a palm, a sole, a cap, a single taxel)."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return length > 0.0 and float((normals @ (mean / length)).min()) > SHEET


def triangulate(positions: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) between taxels at `positions` (n, 3) [m] with `normals` (n, 3).

    The result is empty for taxels on one line, or if a taxel is farther than 1 mm (`OFF`) from the nearest
    corner of a triangle.
    """
    places, index = np.unique(positions, axis=0, return_index=True)
    if len(places) < 3 or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6) < 2:
        return _NONE
    make = _on_plane if is_sheet(normals) else _around_axis if len(places) > 3 else _between
    faces = index[make(places, normals[index])]
    corners = positions[np.unique(faces)]
    whole = len(corners) > 0 and float(nearest(corners, positions)[0].max()) <= OFF
    return faces if whole else _NONE


def outward(faces: NDArray[np.intp], positions: Array, normals: Array) -> NDArray[np.intp]:
    """Orients triangles anticlockwise, seen from outside. The taxels' normals point outside."""
    inward = np.einsum("fi,fi->f", _unit_normals(faces, positions), normals[faces].mean(axis=1)) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _on_plane(places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) between the taxels of a sheet (flat skin), as indices of taxels."""
    across = np.linalg.svd(normals.mean(axis=0, keepdims=True))[2][1:]
    return _delaunay(places @ across.T)


def _between(places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns the triangle (1, 3) between the three taxels of a limb, or no triangle (0, 3) if this triangle
    would pass through the limb."""
    return _skin_only(np.arange(3)[None], places, normals)


def _around_axis(places: Array, normals: Array) -> NDArray[np.intp]:
    """Returns triangles (f, 3) between the taxels of skin around a limb, as indices of taxels."""
    unrolled, turn, _ = unroll(places, normals)
    unrolled += TIE * np.random.default_rng(0).standard_normal(unrolled.shape)
    n = len(places)
    shift = np.array([turn, 0.0])
    faces = _delaunay(np.concatenate([unrolled - shift, unrolled, unrolled + shift]))
    # Each triangle is found once per turn; that whose lowest taxel is on the middle turn is kept.
    lowest = np.take_along_axis(faces, (faces % n).argmin(axis=1)[:, None], axis=1)[:, 0]
    faces = faces[lowest // n == 1] % n
    faces = faces[[len({*face}) == 3 for face in faces.tolist()]]
    return _skin_only(faces, places, normals)


def unroll(places: Array, normals: Array) -> tuple[Array, float, Array]:
    """Returns a limb's unrolled skin, the circumference [m] of the limb, and three unit vectors (3, 3).

    The unrolled skin (n, 2) [m] has one coordinate around the axis and one along the axis. The first unit
    vector points along the axis. The second and third are perpendicular to the axis: the angle around the
    axis increases from the second to the third.

    The axis is in the direction in which the normals vary least. It passes as near as possible to the
    straight lines through the taxels along their normals.
    """
    axes = np.linalg.eigh(np.cov(normals.T))[1].T
    along, flat, out = places @ axes[0], places @ axes[1:].T, normals @ axes[1:].T
    out = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    beside = np.eye(2) - out[:, :, None] * out[:, None, :]
    towards = np.einsum("nij,nj->i", beside, flat)
    from_axis = flat - np.linalg.lstsq(beside.sum(axis=0), towards, rcond=None)[0]
    around = np.arctan2(from_axis[:, 1], from_axis[:, 0])
    turn = 2.0 * np.pi * np.linalg.norm(from_axis, axis=1).mean()
    return np.column_stack([around / (2.0 * np.pi) * turn, along]), float(turn), axes


def _skin_only(faces: NDArray[np.intp], places: Array, normals: Array) -> NDArray[np.intp]:
    """Removes from the triangles `faces` (f, 3) those that close the open ends of a limb, where there is no
    skin.
    """
    towards = normals[faces].mean(axis=1)
    across = np.abs(np.einsum("fi,fi->f", _unit_normals(faces, places), towards))
    result: NDArray[np.intp] = faces[across > 0.5 * np.linalg.norm(towards, axis=1)]
    return result


def _delaunay(flat: Array) -> NDArray[np.intp]:
    """Returns the Delaunay triangulation of points (n, 2): triangles (f, 3) of point indices.

    The result is empty for points on one line.
    """
    if len(flat) == 3:
        one, other = flat[1:] - flat[0]
        area = abs(one[0] * other[1] - one[1] * other[0])
        return np.arange(3)[None] if area > FLAT * max(one @ one, other @ other) else _NONE
    # SciPy's import takes a fifth of the start of a program, and sleeves and single buttons do without.
    from scipy.spatial import Delaunay, QhullError

    try:
        return np.asarray(Delaunay(flat).simplices, dtype=np.intp)
    except QhullError:
        return _NONE


def _unit_normals(faces: NDArray[np.intp], positions: Array) -> Array:
    a, b, c = positions[faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    result: Array = np.divide(across, lengths, out=np.zeros_like(across), where=lengths > 0.0)
    return result
