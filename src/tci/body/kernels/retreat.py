"""Predicts how touched points of the skin move during a motion, and how deep the skin then enters the
touching objects."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import float64, from_dtype, int64, void
from numpy.typing import NDArray

from tci.messages.contacts import CONTACT
from tci.messages.frames import Array
from tci.robot.kernels.limb import Vector
from tci.robot.kernels.links import STEPS, VISITS, take_steps
from tci.skin.kernels.arrays import LAYOUT, LayoutArrays
from tci.skin.kernels.nearest import nearest
from tci.support.compiled import compiled, inlined, reads, record, writes

NEAR = np.dtype([(name, np.float64) for name in ("x", "y", "z", "free", "limit")])
"""The sphere that represents a touching object, relative to a patch: its centre [m] in the frame of the
patch's link, the distance [m] that it can move before it can touch the patch, and the distance [m] from the
centre below which skin counts as inside."""
STILL = 1e-9
"""Largest displacement [m] of a touching object relative to a link that counts as no displacement."""


class Chain(NamedTuple):
    """Kinematics of the links with skin: steps from one joint to the next, in the arrays of
    `tci.robot.kinematics`."""

    path: NDArray[np.void]
    steps: NDArray[np.void]
    sums: Array
    ends: NDArray[np.int64]
    """For each of p patches, the index (p,) in `steps` of the step, from one joint to the next, that ends at
    the patch's link."""


class Room(NamedTuple):
    """Arrays for intermediate results of `retreats`."""

    work: Array
    """Poses (s, 3, 4) in the world frame, one for each of s kinematic steps (from one joint to the next) at
    the current posture."""
    first: Array
    """Initial place [m] and outward normal of each of c touched points, in the world frame, as two columns
    (c, 3, 2)."""
    near: NDArray[np.void]
    """The sphere at each of c touched points, relative to each of p patches, as NEAR (c, p)."""
    found: Array
    """Result (2, 3) of the latest search on a patch: the surface point [m] that is nearest to the centre of a
    touching sphere, and the normal there."""


CHAIN = record(Chain, VISITS, STEPS, reads(4), reads(1, int64))
ROOM = record(Room, writes(3), writes(3), writes(2, from_dtype(NEAR)), writes(2))


@inlined
def _gap(point: Vector, p: int, layout: LayoutArrays, radius: float, found: Array) -> float:
    """Returns the distance [m] of a point from the surface of patch `p`, in the frame of the patch's link.

    For a point that is surely farther away than `radius` [m], a lower bound on the distance is returned
    instead.
    """
    patch = layout.patches[p]
    if patch.cells[0] > 0:
        square = 0.0
        for i in range(3):
            low, size = patch.corner[i], patch.cells[i] / patch.cells_per_metre
            outside = max(low - point[i], point[i] - low - size, 0.0)
            square += outside * outside
        if square > radius * radius:
            bound: float = np.sqrt(square)
            return bound
    nearest(point, p, layout, found[0], found[1])
    x, y, z = point[0] - found[0, 0], point[1] - found[0, 1], point[2] - found[0, 2]
    distance: float = np.sqrt(x * x + y * y + z * z)
    return distance


@inlined
def _depth(centre: Vector, p: int, layout: LayoutArrays, radius: float, near: Any, found: Array) -> float:
    """Returns the greatest depth [m] by which patch `p` enters a sphere of `radius` [m], while the sphere's
    centre moves from its last position to `centre` [m]. Depth at the start of the whole motion does not
    count.

    Positions are in the frame of the patch's link. `near` is the element of `Room.near` for this sphere
    and patch; it contains the last position and is updated.
    """
    x, y, z = near.x, near.y, near.z
    u, v, w = centre[0] - x, centre[1] - y, centre[2] - z
    near.x, near.y, near.z = centre
    length = np.sqrt(u * u + v * v + w * w)
    depth: float = 0.0
    done = 0.0
    if length <= STILL:
        return depth
    while near.free < length - done:
        done = min(done + max(near.free, 0.5 * radius), length)
        s = done / length
        gap = _gap((x + s * u, y + s * v, z + s * w), p, layout, radius, found)
        depth = max(depth, near.limit - gap)
        near.free = max(gap - near.limit, 0.0)
        if done >= length:
            return depth
    near.free -= length - done
    return depth


@compiled(
    void(
        reads(2), CHAIN, reads(1, int64), reads(1, from_dtype(CONTACT)), LAYOUT, float64, ROOM, writes(3)
    )
)  # fmt: skip
def retreats(
    way: Array,
    chain: Chain,
    after: NDArray[np.int64],
    contacts: NDArray[np.void],
    layout: LayoutArrays,
    radius: float,
    room: Room,
    out: Array,
) -> None:
    """Predicts how c touched points move away from the touching objects in k successive postures.

    Args:
        way: Angles (k + 1, n_servos) [rad]: the initial posture, then the k postures.
        chain: Kinematics of the links with skin.
        after: For each contact, the index (c,) of the kinematic step that ends at its link.
        contacts: `Contacts.rows`.
        layout: The taxels of all patches.
        radius: Each object is a sphere of this radius [m] that touches its point from outside and does not
            move.
        room: Intermediate results.
        out: Output (3, k, c): displacements [m] of the points. Row 0 is the component along the initial
            inward normal, row 1 the length of the component perpendicular to it. Row 2 is the depth by which
            skin of any patch enters the sphere on the way from the previous posture, in addition to the depth
            at the start; with the radius 0 it is not written.
    """
    work, first = room.work, room.first
    for k in range(len(way)):
        take_steps(way[k], chain.path, chain.steps, chain.sums, work)
        for c in range(len(after)):
            T, p, n = work[after[c]], contacts[c].p_L, contacts[c].n_L
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
                        near.x, near.y, near.z = centre
                        gap = _gap(centre, patch, layout, radius, room.found)
                        near.limit = min(radius, gap)
                        near.free = gap - near.limit
                    else:
                        depth = max(depth, _depth(centre, patch, layout, radius, near, room.found))
                if k > 0:
                    out[2, k - 1, c] = depth
