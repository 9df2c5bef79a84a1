"""Outward normals of a skin, estimated from the positions of its taxels.

Each normal is that of the plane through a taxel's neighbours. The signs of neighbouring normals are made
consistent along a minimum spanning tree, whose edge weights depend on the angle between normals (Hoppe et al.
1992, section 3.3). Finally all normals are directed outward, away from the centroid of the taxels.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from tci.frames import Array

NEIGHBOURS = 10
"""Number of points to which a plane is fitted, including the taxel itself. Assumed: a module has ten
taxels."""

FLAT = 1e-3
"""Distance [m] (RMS) from one plane below which a skin counts as flat. Assumed: files may round positions to
a millimetre."""

DISAGREE = np.radians(30.0)
"""Median angle [rad] between listed normals and the planes through their neighbours above which the listed
ones belong to another skin. Assumed: genuine skins stay below 15 degrees, wrong lists are at 50 and more."""
THIN = 0.35
"""Largest ratio of a neighbourhood's thickness to its width for which its plane is used. Assumed: if taxels
are far apart on a limb, their neighbours are all around the limb."""


def disagreement(positions: Array, normals: Array) -> float:
    """Returns the median angle [rad] between `normals` (n, 3) and the planes through the neighbours of
    `positions` (n, 3) [m]; 0 if fewer than `NEIGHBOURS` have a neighbourhood that is nearly flat."""
    places, index = np.unique(positions, axis=0, return_index=True)
    if len(places) < NEIGHBOURS:
        return 0.0
    near = cKDTree(places).query(places, k=NEIGHBOURS)[1]
    _, spread, axes = np.linalg.svd(places[near] - places[near].mean(axis=1, keepdims=True))
    flat = spread[:, 2] < THIN * spread[:, 1]
    if np.count_nonzero(flat) < NEIGHBOURS:
        return 0.0
    along = np.abs(np.einsum("ni,ni->n", axes[flat, 2], normals[index][flat]))
    return float(np.median(np.arccos(np.clip(along, 0.0, 1.0))))


def estimate_normals(positions: Array) -> Array:
    """Returns outward unit normals (n, 3) of taxels at `positions` (n, 3) [m], in the frame of the positions.

    Repeated positions get the same normal. Fewer than three points, or points on one line, define no plane:
    their normals are zero. A curved skin is turned away from its centroid. The inside of a flat skin is not
    known from its positions; its normals point away from the origin of its frame, since the origin of a link
    is inside the link.
    """
    places, index = np.unique(positions, axis=0, return_inverse=True)
    from_middle = places - places.mean(axis=0)
    if len(places) < 3 or np.linalg.matrix_rank(from_middle, tol=1e-6) < 2:
        return np.zeros_like(positions)
    near = cKDTree(places).query(places, k=min(NEIGHBOURS, len(places)))[1]
    around = places[near] - places[near].mean(axis=1, keepdims=True)
    # Its import takes a twentieth of the start of a run, and sleeves do without.
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

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
