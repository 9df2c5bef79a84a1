"""Forward kinematics and Jacobians of several links in one compiled loop."""

from __future__ import annotations

import numpy as np
from numba import from_dtype, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, views, writes

STEP = np.dtype([("before", np.int64), ("servo", np.int64), ("slides", np.int64)])
"""A step: a fixed offset or a joint on the way from the world to a link. Its fields are: index of the
previous step (-1 for the world), index of the servo (-1 for none), and 1 if the joint is prismatic, otherwise
0."""
VISIT = np.dtype([("step", np.int64), ("sign", np.int64)])
"""A step on the way to some links: its index among all steps, and the sign (1 or -1) with which its servo
counts in a Jacobian; 0 if it does not count."""
STEPS, VISITS = reads(1, from_dtype(STEP)), reads(1, from_dtype(VISIT))
"""Numba types of an array of STEP, and of VISIT."""


@inlined
def take_steps(
    position: Array, path: NDArray[np.void], steps: NDArray[np.void], sums: Array, work: Array
) -> None:
    """Computes the pose in the world frame at the end of each step (fixed offset or joint) of `path`, and
    writes it into the step's row of `work` (s, 3, 4). The arguments are those of `link_poses`."""
    for k in range(len(path)):
        s = path[k].step
        before, servo = steps[s].before, steps[s].servo
        x = y = 0.0
        if servo >= 0:
            q = position[servo]
            x, y = (q, 0.0) if steps[s].slides else (np.cos(q), np.sin(q))
        for j in range(4):
            a, b, c = (
                sums[s, 0, 0, j] + x * sums[s, 1, 0, j] + y * sums[s, 2, 0, j],
                sums[s, 0, 1, j] + x * sums[s, 1, 1, j] + y * sums[s, 2, 1, j],
                sums[s, 0, 2, j] + x * sums[s, 1, 2, j] + y * sums[s, 2, 2, j],
            )
            if before < 0:
                work[s, 0, j], work[s, 1, j], work[s, 2, j] = a, b, c
                continue
            for i in range(3):
                T = work[before, i]
                work[s, i, j] = T[0] * a + T[1] * b + T[2] * c + (T[3] if j == 3 else 0.0)


@compiled(void(reads(1), VISITS, STEPS, reads(4), reads(1, int64), int64, writes(3), writes(3)))
def link_poses(
    position: Array,
    path: NDArray[np.void],
    steps: NDArray[np.void],
    sums: Array,
    ends: NDArray[np.int64],
    torso: int,
    work: Array,
    poses: Array,
) -> None:
    """Computes the poses `T_TL` of l links in the torso frame, and writes them into `poses` (l, 4, 4).

    The kinematic model consists of s steps; a step is a fixed offset or a joint. `ends` (l,) are the indices
    of the steps that end at the links, and `torso` is the index of the step that ends at the torso frame.

    `position` (n,) [rad] are the angles of the servos, and then of the joints that follow servos. `path` (k,)
    lists all required steps as VISIT, each after the step before it. `steps` (s,) and `sums` (s, 3, 3, 4) are
    those of `KinematicChain`. `work` (s, 3, 4) is work space.
    """
    take_steps(position, path, steps, sums, work)
    T_WT = work[torso]
    for link in range(len(ends)):
        T_WL, T_TL = work[ends[link]], poses[link]
        for j in range(4):
            a, b, c = T_WL[0, j], T_WL[1, j], T_WL[2, j]
            if j == 3:
                a, b, c = a - T_WT[0, 3], b - T_WT[1, 3], c - T_WT[2, 3]
            for i in range(3):
                T_TL[i, j] = T_WT[0, i] * a + T_WT[1, i] * b + T_WT[2, i] * c
            T_TL[3, j] = 1.0 if j == 3 else 0.0


@compiled(
    void(
        reads(1), VISITS, STEPS, reads(4), reads(3), reads(1, int64), views(1), writes(3),
        writes(2), writes(2),
    )
)  # fmt: skip
def pose_and_jacobian(
    position: Array,
    path: NDArray[np.void],
    steps: NDArray[np.void],
    sums: Array,
    axes: Array,
    ends: NDArray[np.int64],
    point: Array,
    work: Array,
    pose: Array,
    jacobian: Array,
) -> None:
    """Computes the pose `T_TP` of a point of a link, and the Jacobian of this point, both in the torso frame.
    Writes the pose into `pose` (4, 4), and adds the Jacobian to `jacobian` (6, n), which must contain zeros
    before.

    `point` (3,) [m] is given in the link's frame. `ends` (2,) are the indices of the steps that end at the
    link and at the torso frame; a step is a fixed offset or a joint. The Jacobian has one column for each
    angle in `position` (n,) [rad]; its rows are the velocity of the point [m/rad] and the angular velocity
    [rad/rad]. `axes` (s, 2, 3) contains the axis of each step's joint and a point [m] on this axis, in the
    frame before the step. The other arguments are those of `link_poses`.
    """
    take_steps(position, path, steps, sums, work)
    T_WL, T_WT = work[ends[0]], work[ends[1]]
    x, y, z = (
        T_WL[0, 0] * point[0] + T_WL[0, 1] * point[1] + T_WL[0, 2] * point[2] + T_WL[0, 3],
        T_WL[1, 0] * point[0] + T_WL[1, 1] * point[1] + T_WL[1, 2] * point[2] + T_WL[1, 3],
        T_WL[2, 0] * point[0] + T_WL[2, 1] * point[1] + T_WL[2, 2] * point[2] + T_WL[2, 3],
    )
    for i in range(3):
        for j in range(3):
            pose[i, j] = T_WT[0, i] * T_WL[0, j] + T_WT[1, i] * T_WL[1, j] + T_WT[2, i] * T_WL[2, j]
        pose[i, 3] = (
            T_WT[0, i] * (x - T_WT[0, 3]) + T_WT[1, i] * (y - T_WT[1, 3]) + T_WT[2, i] * (z - T_WT[2, 3])
        )
        pose[3, i] = 0.0
    pose[3, 3] = 1.0
    for k in range(len(path)):
        s, sign = path[k].step, float(path[k].sign)
        if sign == 0.0:
            continue
        before, column = steps[s].before, steps[s].servo
        a, b, c = axes[s, 0, 0], axes[s, 0, 1], axes[s, 0, 2]
        p, q, r = axes[s, 1, 0], axes[s, 1, 1], axes[s, 1, 2]
        if before >= 0:
            T = work[before]
            a, b, c = (
                T[0, 0] * a + T[0, 1] * b + T[0, 2] * c,
                T[1, 0] * a + T[1, 1] * b + T[1, 2] * c,
                T[2, 0] * a + T[2, 1] * b + T[2, 2] * c,
            )
            p, q, r = (
                T[0, 0] * p + T[0, 1] * q + T[0, 2] * r + T[0, 3],
                T[1, 0] * p + T[1, 1] * q + T[1, 2] * r + T[1, 3],
                T[2, 0] * p + T[2, 1] * q + T[2, 2] * r + T[2, 3],
            )
        slides = steps[s].slides == 1
        u, v, w = (
            (a, b, c)
            if slides
            else (b * (z - r) - c * (y - q), c * (x - p) - a * (z - r), a * (y - q) - b * (x - p))
        )
        for i in range(3):
            jacobian[i, column] += sign * (T_WT[0, i] * u + T_WT[1, i] * v + T_WT[2, i] * w)
            if not slides:
                jacobian[3 + i, column] += sign * (T_WT[0, i] * a + T_WT[1, i] * b + T_WT[2, i] * c)
