"""Outward normals of a skin, estimated from the positions of its taxels.

Each normal is perpendicular to the plane through a taxel's neighbours. The signs of neighbouring normals are
made consistent along a minimum spanning tree. The weight of an edge of this tree depends on the angle between
two normals (Hoppe et al. 1992, section 3.3). Finally all normals are directed outward, away from the centroid
of the taxels.
"""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array

NEIGHBOURS = 10
"""Number of points to which a plane is fitted. The taxel itself is one of these points. Assumed: a module has
ten taxels."""

FLAT = 1e-3
"""RMS distance [m] of the taxels from one plane below which a skin counts as flat. Assumed: files may round
positions to a millimetre."""

DISAGREE = np.radians(30.0)
"""The normals in a file count as wrong if their median angle [rad] to the normals of planes through
neighbouring taxels is above this value. Assumed: in known files, the median is below 15 degrees for correct
normals, and at least 50 degrees for wrong normals."""
THIN = 0.35
"""A plane is fitted to a group of neighbouring taxels only if the ratio of the group's thickness to its width
is at most this value. Assumed: if taxels are far apart on a limb, their neighbours are all around the limb,
so that a plane does not fit them."""


def disagreement(positions: Array, normals: Array) -> float:
    """Returns the median angle [rad] between `normals` (n, 3) and the normals of the planes through
    neighbouring `positions` (n, 3) [m].

    Only taxels with nearly flat neighbourhoods are used. If too few taxels have a flat neighbourhood, the
    result is 0.
    """
    places, index = np.unique(positions, axis=0, return_index=True)
    if len(places) < NEIGHBOURS:
        return 0.0
    from scipy.spatial import cKDTree

    near = cKDTree(places).query(places, k=NEIGHBOURS)[1]
    _, spread, axes = np.linalg.svd(places[near] - places[near].mean(axis=1, keepdims=True))
    flat = spread[:, 2] < THIN * spread[:, 1]
    if np.count_nonzero(flat) < NEIGHBOURS:
        return 0.0
    along = np.abs(np.einsum("ni,ni->n", axes[flat, 2], normals[index][flat]))
    return float(np.median(np.arccos(np.clip(along, 0.0, 1.0))))


def estimate_normals(positions: Array) -> Array:
    """Returns outward unit normals (n, 3) of taxels at `positions` (n, 3) [m], in the frame of the positions.

    Taxels at equal positions get equal normals. Fewer than three points, or points on one line, define no
    plane: their normals are zero. On a curved skin, normals point away from the centroid of the skin. For a
    flat skin, positions do not show which side is outside. The normals of a flat skin therefore point away
    from the origin of the frame, because the origin of a link's frame is usually inside the link.
    """
    places, index = np.unique(positions, axis=0, return_inverse=True)
    from_middle = places - places.mean(axis=0)
    if len(places) < 3 or np.linalg.matrix_rank(from_middle, tol=1e-6) < 2:
        return np.zeros_like(positions)
    # The imports take a fifth of the start of a program, and sleeves and single buttons do without.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
    from scipy.spatial import cKDTree

    near = cKDTree(places).query(places, k=min(NEIGHBOURS, len(places)))[1]
    around = places[near] - places[near].mean(axis=1, keepdims=True)
    normals = np.linalg.svd(around)[2][:, 2]
    spread = np.linalg.svd(from_middle)[1] / np.sqrt(len(places))
    outward = places if len(spread) < 3 or spread[2] < FLAT else from_middle
    near = near.astype(np.int32)  # SciPy's graphs before 1.17.1 accept no wider index
    one, other = np.repeat(np.arange(len(near), dtype=np.int32), near.shape[1]), near.ravel()
    # A weight of zero would mean no edge, so parallel neighbours get a weight just above zero.
    weights = 1.001 - np.abs(np.einsum("pi,pi->p", normals[one], normals[other]))
    tree = minimum_spanning_tree(csr_array((weights, (one, other)), shape=(len(places), len(places))))
    seen = np.zeros(len(places), dtype=bool)
    while not seen.all():
        group, before = breadth_first_order(tree, int(np.argmin(seen)), directed=False)
        for place in group[1:]:
            if normals[place] @ normals[before[place]] < 0.0:
                normals[place] *= -1.0
        if np.einsum("ni,ni->", normals[group], outward[group]) < 0.0:
            normals[group] *= -1.0
        seen[group] = True
    result: Array = normals[index.ravel()]
    return result
