"""Lower bounds on the distances of pairs of links, computed without measuring distances.

There are two bounds. One is the distance measured at an earlier posture, minus the largest change that the
joints can have caused since then. The other is the distance between the projections of the two links' convex
shapes onto a line (separating axis, Ericson 2004, 5.2.1). Its direction is that between the two links in the
last measurement.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.robot.kernels.links import STEPS, VISITS, take_steps
from tci.skin.kernels.arrays import Indices
from tci.support.compiled import compiled, inlined, reads, returns, writes

SOLIDS = returns(
    VISITS, STEPS, reads(4), reads(2), reads(2), reads(2), reads(2, int32), reads(2)
)  # fmt: skip
"""Numba types of the arrays `path`, `steps`, `sums`, `shapes`, `points`, `poses`, `pairs` and `levers` of the
class `Solids`, in this order."""
KNOWN = returns(
    writes(2), writes(1), writes(2), writes(1, int32), writes(1), writes(1), writes(1), writes(3), writes(1)
)  # fmt: skip
"""Numba types of the nine arrays in which the loops of this file store the known distances of p pairs of
collision shapes, and intermediate results.

The arrays, in this order:

- angles (j, p) [rad] of the j joints at which the distance of each pair was found
- this distance (p,) [m], or a lower bound on it
- unit vector (p, 3) from the first to the second shape of each pair; zeros if unknown
- indices of the pairs that may be too close and must be checked further, at the beginning of an array (p,)
- lower bound (p,) [m] on the distance of each pair; while a path is checked: minus the distance that the pair
  must keep
- least allowed distance (p,) [m] of each pair
- largest change (p,) [m] of each pair's distance from one point of the path to the next
- pose (j, 3, 4) of each joint's frame: rotation matrix, and position [m] in the last column
- angles (j,) [rad] of the joints at which these frames were computed
"""
Arrays = tuple[Array, ...]
SPARE, WIDER = 0.002, 0.5
"""Reserve by which a range of joint angles is extended at both ends before it is checked for collisions:
SPARE [rad] plus the fraction WIDER of the range's width. Later ranges inside the extended range need no
check. Assumed: SPARE is above the noise of encoders; a moving joint stays in the reserve for about ten
periods."""
PAUSE = 16
"""Number of collision checks without the reserve `SPARE`, after a check has failed with the reserve because
links may come near each other there. Assumed: with this pause, the repeated checks take little time on
average."""


@inlined
def _shadow(shapes: Array, points: Array, frames: Array, shape: int, x: float, y: float, z: float) -> float:
    """Returns the largest coordinate [m] of the shape with the index `shape` along the unit vector (x, y, z)
    of the world frame."""
    j = int(shapes[shape, 0])
    start = 0.0
    if j >= 0:
        T = frames[j]
        start = x * T[0, 3] + y * T[1, 3] + z * T[2, 3]
        x, y, z = (
            x * T[0, 0] + y * T[1, 0] + z * T[2, 0],
            x * T[0, 1] + y * T[1, 1] + z * T[2, 1],
            x * T[0, 2] + y * T[1, 2] + z * T[2, 2],
        )
    farthest = -np.inf
    for v in range(int(shapes[shape, 1]), int(shapes[shape, 2])):
        farthest = max(farthest, x * points[v, 0] + y * points[v, 1] + z * points[v, 2])
    square = 0.0
    for i in range(3):
        e = x * shapes[shape, 7 + i] + y * shapes[shape, 10 + i] + z * shapes[shape, 13 + i]
        square += e * e
    reach: float = start + farthest + np.sqrt(square)
    return reach


@inlined
def _centre(shapes: Array, frames: Array, shape: int) -> tuple[float, float, float]:
    """Returns the centre (x, y, z) [m] of the bounding sphere of the shape with the index `shape`, in the
    world frame."""
    j = int(shapes[shape, 0])
    x, y, z = shapes[shape, 3], shapes[shape, 4], shapes[shape, 5]
    if j < 0:
        return x, y, z
    T = frames[j]
    return (
        T[0, 3] + T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 3] + T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 3] + T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@inlined
def at_least(shapes: Array, points: Array, frames: Array, pairs: Indices, axis: Array, p: int) -> float:
    """Returns a lower bound [m] on the distance between the two shapes of pair `p`, while the joints have
    the poses `frames` (j, 3, 4). `axis[p]` is a unit vector along which the shapes are probably far apart;
    zeros if no such vector is known."""
    one, other = pairs[p, 0], pairs[p, 1]
    ax, ay, az = _centre(shapes, frames, one)
    bx, by, bz = _centre(shapes, frames, other)
    x, y, z = bx - ax, by - ay, bz - az
    found: float = np.sqrt(x * x + y * y + z * z) - shapes[one, 6] - shapes[other, 6]
    x, y, z = axis[p, 0], axis[p, 1], axis[p, 2]
    if x != 0.0 or y != 0.0 or z != 0.0:
        shadow = -_shadow(shapes, points, frames, one, x, y, z)
        shadow -= _shadow(shapes, points, frames, other, -x, -y, -z)
        found = max(found, shadow)
    return found


@inlined
def to_joints(servos: NDArray[np.intp], zero: Array, box: Array, ends: Array) -> None:
    """Converts the least and largest angles `box` (2, n_servos) [rad] of a robot's servos to angles of its
    model's joints, and writes these into `ends` (2, j) [rad].

    `servos` (j,) are the indices of the servos that move the joints. `zero` (j,) [rad] are the angles of
    these servos while the joints are at 0.
    """
    for j in range(len(servos)):
        for k in range(2):
            ends[k, j] = box[k, servos[j]] - zero[j]


@inlined
def _count_near(solids: Arrays, known: Arrays, ends: Array, margin: float) -> int:
    """Returns the number of pairs of shapes that may come as close as `margin` [m] while the joints are
    between the least and largest angles `ends` (2, j) [rad]. Writes the indices of these pairs into the
    fourth array of `known` (see `KNOWN`)."""
    path, steps, sums, shapes, points, _, pairs, levers = solids
    posture, distance, axis, left, bound, _, _, frames, middle = known
    low, high = ends
    for p in range(len(pairs)):
        bound[p] = distance[p]
    for j in range(len(steps)):
        for p in range(len(pairs)):
            far = max(abs(low[j] - posture[j, p]), abs(high[j] - posture[j, p]))
            bound[p] -= far * levers[j, p]
    count, ready = 0, False
    for p in range(len(pairs)):
        if bound[p] > margin:
            continue
        if not ready:
            for j in range(len(steps)):
                middle[j] = (low[j] + high[j]) / 2.0
            take_steps(middle, path, steps, sums, frames)
            ready = True
        there, way = distance[p], 0.0
        for j in range(len(steps)):
            there -= abs(middle[j] - posture[j, p]) * levers[j, p]
            way += (high[j] - low[j]) / 2.0 * levers[j, p]
        now = at_least(shapes, points, frames, pairs, axis, p)
        if now > there:
            distance[p] = now
            for j in range(len(steps)):
                posture[j, p] = middle[j]
        if not max(now, there) - way > margin:
            left[count] = p
            count += 1
    return count


@compiled(
    int64(
        SOLIDS, KNOWN, reads(1, int64), reads(1), writes(2), writes(1, int64), reads(2), writes(2), float64
    )
)  # fmt: skip
def come_near(
    solids: Arrays, known: Arrays, servos: NDArray[np.intp], zero: Array, safe: Array, pause: Indices,
    box: Array, ends: Array, margin: float,
) -> int:  # fmt: skip
    """Returns the number of pairs of links that may come as close as `margin` [m] while the servos are
    between the least and largest angles `box` (2, n_servos) [rad].

    If the number is not 0, writes the indices of these pairs into the fourth array of `known`. Writes the
    least and largest angles [rad] of the model's joints into `ends` (2, j). The arrays of `solids` and
    `known` are listed at `SOLIDS` and `KNOWN`; `servos` and `zero` are arrays of `Solids`.

    The arrays `safe` and `pause` only save time: this function stores in them, for later calls, a range of
    joint angles (2, j) [rad] in which no pair comes near, and the number of checks until a new range is
    tried.
    """
    to_joints(servos, zero, box, ends)
    inside = True
    for j in range(len(servos)):
        inside = inside and safe[0, j] <= ends[0, j] and ends[1, j] <= safe[1, j]
    if inside:
        return 0
    for j in range(len(servos)):
        reserve = SPARE + WIDER * (ends[1, j] - ends[0, j])
        safe[0, j], safe[1, j] = ends[0, j] - reserve, ends[1, j] + reserve
    count = 0
    for trial in range(2):
        if trial == 0 and pause[0] > 0:
            continue
        count = _count_near(solids, known, safe if trial == 0 else ends, margin)
        if trial == 0 and not count:
            return 0
        pause[0] = PAUSE if trial == 0 else pause[0] - 1
    safe[0] = np.inf
    return count


@compiled(
    int64(SOLIDS, KNOWN, int64, reads(2), reads(1), float64, float64, writes(1, int64), writes(1, int32))
)
def follow(
    solids: Arrays, known: Arrays, count: int, path: Array, levers: Array, stride: float, margin: float,
    at: Indices, asked: Indices,
) -> int:  # fmt: skip
    """Follows `path` (k, j), a path of joint angles [rad], to the first point at which two links may be too
    close, so that their distance must be measured.

    Returns the number of pairs to measure there; 0 at the end of the path. Checks only the first `count`
    pairs listed in `known`, which must keep the distance `margin` [m]. Between two checked points, no
    distance changes by more than `stride` [m]; `levers` (j,) [m/rad] are the largest changes per radian of
    each joint. Writes into `asked` the indices of the pairs to measure, and into the last two arrays of
    `known` the poses and angles of the joints at this point. The next call continues at the place `at` (2,),
    which is zeros at the beginning.
    """
    way_up, steps, sums, shapes, points, _, pairs, own = solids
    posture, distance, axis, left, slack, least, step, frames, angles = known
    joints = range(len(steps))
    if at[0] == 0 and at[1] == 0:
        for u in range(count):
            p = left[u]
            least[p], slack[p], way = margin, distance[p] - margin, 0.0
            for j in joints:
                slack[p] -= abs(path[0, j] - posture[j, p]) * own[j, p]
                for k in range(len(path) - 1):
                    way += abs(path[k + 1, j] - path[k, j]) * own[j, p]
            if way == 0.0:  # shapes that do not move come no closer
                slack[p] = np.inf
    while at[0] < len(path) - 1:
        here, there = path[at[0]], path[at[0] + 1]
        way = 0.0
        for j in joints:
            way += abs(there[j] - here[j]) * levers[j]
        parts = max(1, int(np.ceil(way / stride)))
        for u in range(count):
            p = left[u]
            step[p] = 0.0
            for j in joints:
                step[p] += abs(there[j] - here[j]) * own[j, p] / parts
        while at[1] < parts:
            free = parts - at[1]  # number of points for which the slack of all pairs suffices
            for u in range(count):
                p = left[u]
                if not slack[p] > free * step[p]:
                    free = min(free, int(slack[p] / step[p])) if slack[p] > 0.0 else 0
            for u in range(count):
                slack[left[u]] -= free * step[left[u]]
            at[1] += free
            if at[1] == parts:
                break
            at[1] += 1
            share = at[1] / parts
            for j in joints:
                angles[j] = here[j] * (1.0 - share) + there[j] * share
            take_steps(angles, way_up, steps, sums, frames)
            found = 0
            for u in range(count):
                p = left[u]
                slack[p] -= step[p]
                if slack[p] > 0.0:
                    continue
                now = at_least(shapes, points, frames, pairs, axis, p)
                slack[p] = max(now - margin, 0.0)
                if not (now > margin or now >= least[p]):
                    asked[found] = p
                    found += 1
            if found:
                return found
        at[0] += 1
        at[1] = 0
    return 0


@compiled(void(SOLIDS, reads(1), writes(3), writes(2), writes(2), reads(1, int32)))
def stand(
    solids: Arrays, angles: Array, frames: Array, positions: Array, rotations: Array, geoms: Indices
) -> None:
    """Computes the poses of all collision shapes in the world at the joint angles `angles` (j,) [rad]. Writes
    the poses into the arrays of a MuJoCo model with n geoms: `positions` (n, 3) [m] and `rotations` (n, 9).
    `geoms` (g,) are the indices of the shapes' geoms. `frames` (j, 3, 4) receives the poses of the
    joints."""
    path, steps, sums, shapes, _, poses, _, _ = solids
    take_steps(angles, path, steps, sums, frames)
    for g in range(len(geoms)):
        j, geom = int(shapes[g, 0]), geoms[g]
        for i in range(3):
            for k in range(3):
                if j < 0:
                    rotations[geom, 3 * i + k] = poses[g, 3 + 3 * i + k]
                    continue
                value = 0.0
                for m in range(3):
                    value += frames[j, i, m] * poses[g, 3 + 3 * m + k]
                rotations[geom, 3 * i + k] = value
            if j < 0:
                positions[geom, i] = poses[g, i]
                continue
            value = frames[j, i, 3]
            for m in range(3):
                value += frames[j, i, m] * poses[g, m]
            positions[geom, i] = value
