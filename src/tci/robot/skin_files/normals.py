"""Outward normals of a skin of which only the taxels' positions are known.

Each normal is that of the plane through a taxel's neighbours. Neighbours are then made to agree along
a minimum spanning tree of how parallel they are (Hoppe et al. 1992, section 3.3), and the skin is
turned outward: away from the middle of its taxels.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from tci.frames import Array

NEIGHBOURS = 10
"""Places through which a plane is laid, the taxel's own among them. Ours: a module has ten taxels."""

FLAT = 1e-3
"""A skin within this distance [m] (RMS) of one plane counts as flat. Ours."""


def estimate_normals(positions: Array) -> Array:
    """Outward unit normals (n, 3) of taxels at `positions` (n, 3) [m], in the frame of the positions.

    Repeated positions get the same normal. Fewer than three places, or places on one line, span no
    plane: their normals are zero. A bent skin is turned away from its middle. A flat one has no inside;
    it is turned away from the origin of its frame, since a link's origin is inside the link.
    """
    places, index = np.unique(positions, axis=0, return_inverse=True)
    from_middle = places - places.mean(axis=0)
    if len(places) < 3 or np.linalg.matrix_rank(from_middle, tol=1e-6) < 2:
        return np.zeros_like(positions)
    near = cKDTree(places).query(places, k=min(NEIGHBOURS, len(places)))[1]
    around = places[near] - places[near].mean(axis=1, keepdims=True)
    normals = np.linalg.svd(around)[2][:, 2]
    spread = np.linalg.svd(from_middle)[1] / np.sqrt(len(places))
    outward = places if len(spread) < 3 or spread[2] < FLAT else from_middle
    near = near.astype(np.int32)  # SciPy's graphs before 1.17.1 take no wider index
    one, other = np.repeat(np.arange(len(near), dtype=np.int32), near.shape[1]), near.ravel()
    # A weight of zero would be no edge at all, so that of parallel neighbours is just above it.
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
