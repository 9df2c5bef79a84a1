"""Displacement of contact points, and distance of the skin from the touching objects, along a path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, void
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, record, writes
from tci.frames import Array
from tci.robot.kernels.limb import Vector
from tci.robot.kernels.links import take_steps
from tci.skin.kernels.arrays import LAYOUT, LayoutArrays
from tci.skin.kernels.nearest import nearest

FREE, LIMIT = 3, 4
"""Columns of `Room.near`, after the centre of the sphere (see `retreats`). `FREE`: length [m] of the path
ahead on which surely no skin enters the sphere. `LIMIT`: distance [m] from the centre below which skin counts
as inside the sphere."""
STILL = 1e-9
"""Length of a path [m] up to which a link counts as not moved."""


class Chain(NamedTuple):
    """Kinematics of the links with skin, see `link_poses`."""

    path: NDArray[np.int64]
    steps: NDArray[np.int64]
    sums: Array
    ends: NDArray[np.int64]
    """Index (p,) into `steps`, for each of p patches: the step that ends at the patch's link. A step leads
    from one joint of the kinematic model to the next."""


class Touched(NamedTuple):
    """Points of the skin that are touched."""

    after: NDArray[np.int64]
    """Index (c,) in `Chain.steps` of the last step on the kinematic path to the link of each touched point.
    """
    points: Array
    """Touched points (c, 3) [m], each in the frame of its link."""
    normals: Array
    """Outward normals (c, 3), each in the frame of its point's link."""


class Room(NamedTuple):
    """Work space of `retreats`, for c touched points, p patches and s steps."""

    work: Array
    """Poses (s, 3, 4) in the world frame at the current posture, one after each of the s steps of the
    kinematics from the base to the links."""
    first: Array
    """Initial points and normals (c, 3, 2) in the world frame."""
    near: Array
    """State (c, p, 5) of the sphere at each touched point relative to each patch: centre [m] in the frame of
    the patch's link (3 columns), and the columns `FREE` and `LIMIT`."""
    found: Array
    """Rows (2, 3): the surface point [m] of a patch that is nearest to the centre of a touching sphere, and
    the normal at this point."""


CHAIN = record(Chain, reads(2, int64), reads(2, int64), reads(4), reads(1, int64))
TOUCHED = record(Touched, reads(1, int64), reads(2), reads(2))
ROOM = record(Room, writes(3), writes(3), writes(3), writes(2))


@compiled(void(reads(2), CHAIN, TOUCHED, LAYOUT, float64, ROOM, writes(3)))
def retreats(
    way: Array,
    chain: Chain,
    touched: Touched,
    layout: LayoutArrays,
    radius: float,
    room: Room,
    out: Array,
) -> None:
    """Writes the displacements [m] of c touched points from their initial places, in the world frame, into
    `out`: `out[0]` (k, c) along the initial inward normals of the points, `out[1]` perpendicular to these
    normals.

    `way` (k + 1, n_servos) [rad] contains the postures, and starts at the initial posture. With a `radius`
    [m] above 0, `out[2]` (k, c) contains the depth [m] by which skin of the patches in `layout` enters a
    sphere on the way to each posture. The sphere has this radius, touches the skin at the point from outside,
    and does not move. If skin is inside the sphere already, only the additional depth counts. Between two
    postures, the sphere's centre is assumed to move along a straight line relative to each link.
    """
    work, first = room.work, room.first
    for k in range(len(way)):
        take_steps(way[k], chain.path, chain.steps, chain.sums, work)
        for c in range(len(touched.after)):
            T, p, n = work[touched.after[c]], touched.points[c], touched.normals[c]
            inwards = square = 0.0
            for i in range(3):
                x = T[i, 0] * p[0] + T[i, 1] * p[1] + T[i, 2] * p[2] + T[i, 3]
                if k == 0:
                    first[c, i, 0] = x
                    first[c, i, 1] = T[i, 0] * n[0] + T[i, 1] * n[1] + T[i, 2] * n[2]
                else:
                    x -= first[c, i, 0]
                    inwards -= first[c, i, 1] * x
                    square += x * x
            if k > 0:
                out[0, k - 1, c] = inwards
                out[1, k - 1, c] = np.sqrt(max(square - inwards * inwards, 0.0))
            if radius > 0.0:
                x, y, z = (
                    first[c, 0, 0] + radius * first[c, 0, 1],
                    first[c, 1, 0] + radius * first[c, 1, 1],
                    first[c, 2, 0] + radius * first[c, 2, 1],
                )
                depth = 0.0
                for patch in range(len(chain.ends)):
                    T = work[chain.ends[patch]]
                    a, b, d = x - T[0, 3], y - T[1, 3], z - T[2, 3]
                    centre = (
                        T[0, 0] * a + T[1, 0] * b + T[2, 0] * d,
                        T[0, 1] * a + T[1, 1] * b + T[2, 1] * d,
                        T[0, 2] * a + T[1, 2] * b + T[2, 2] * d,
                    )
                    near = room.near[c, patch]
                    if k == 0:
                        near[0], near[1], near[2] = centre
                        gap = _gap(centre, patch, layout, radius, room.found)
                        near[LIMIT] = min(radius, gap)
                        near[FREE] = gap - near[LIMIT]
                    else:
                        depth = max(depth, _depth(centre, patch, layout, radius, near, room.found))
                if k > 0:
                    out[2, k - 1, c] = depth


@inlined
def _depth(centre: Vector, p: int, layout: LayoutArrays, radius: float, near: Array, found: Array) -> float:
    """Returns the greatest depth [m] by which a patch enters a sphere, while the sphere's centre moves from
    its last position to `centre` [m].

    The positions are given in the patch's link. `near` (5,) is the state of this sphere relative to the patch
    (see `Room.near`); the function updates it. Only some points of the path are examined. If the skin is at a
    distance d from the sphere at one point, it can't touch the sphere at points that are closer than d, so
    these are skipped (sphere tracing, Hart 1996).
    """
    x, y, z = near[0], near[1], near[2]
    u, v, w = centre[0] - x, centre[1] - y, centre[2] - z
    near[0], near[1], near[2] = centre
    length = np.sqrt(u * u + v * v + w * w)
    depth: float = 0.0
    done = 0.0
    if length <= STILL:
        return depth
    while near[FREE] < length - done:
        done = min(done + max(near[FREE], 0.5 * radius), length)
        s = done / length
        gap = _gap((x + s * u, y + s * v, z + s * w), p, layout, radius, found)
        depth = max(depth, near[LIMIT] - gap)
        near[FREE] = max(gap - near[LIMIT], 0.0)
        if done >= length:
            return depth
    near[FREE] -= length - done
    return depth


@inlined
def _gap(point: Vector, p: int, layout: LayoutArrays, radius: float, found: Array) -> float:
    """Returns the distance [m] of a point from the surface of patch `p`.

    If a lower bound on the distance exceeds `radius` [m], returns this bound instead.
    """
    box = layout.box[p]
    if box[4] > 0.0:
        square = 0.0
        for i in range(3):
            outside = max(box[i] - point[i], point[i] - box[i] - box[4 + i] / box[3], 0.0)
            square += outside * outside
        if square > radius * radius:
            bound: float = np.sqrt(square)
            return bound
    nearest(point, p, layout, found[0], found[1])
    x, y, z = point[0] - found[0, 0], point[1] - found[0, 1], point[2] - found[0, 2]
    distance: float = np.sqrt(x * x + y * y + z * z)
    return distance
