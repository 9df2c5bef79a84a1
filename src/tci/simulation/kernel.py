"""Distributes one contact force over the taxels around it.

The kernel is not a model of an elastomer. The sum of the taxels' forces and their centre are correct, but the
forces on single taxels are not.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, views, writes

SIGMA = 3e-3
"""Width [m] (standard deviation) of the Gaussian over which the cover of the taxels spreads a force. Assumed:
half of the pitch of an iCub's taxels, so that a force at a point acts on several neighbouring taxels."""
REACH = 6.0
"""A taxel gets no part of a contact force if it is farther from the point of the force than the nearest taxel
by more than this number of kernel widths. Assumed: its part would be negligible, at most exp(-18) of the
largest part if the parts follow a Gaussian."""
_SOFTNESS = 0.02
"""Factor of a penalty in the computation of the taxels' shares of a force. Assumed: the penalty keeps all
computed numbers finite for a contact beyond the skin's edge."""
_STEPS = 30
_TOLERANCE = 1e-4
"""Error [kernel widths] below which the iterative computation of the taxels' shares of a force ends. Assumed:
for kernels up to 10 mm wide, this is less than a micrometre."""
_LEAST = -60.0
"""Least logarithm of the weight with which a taxel takes part in a contact force; a smaller logarithm is
raised to this value. The largest weight is 1, so exp(-60) is negligible."""
SHARE, _TRIAL, LOGARITHM, ACROSS, UP, _NUMBERS = range(6)
"""Rows of the work space `work`, in which the shares of n taxels in a contact force are computed. It has at
least 6 rows; the number of columns is at least n and at least 8.

- `SHARE`, `_TRIAL`: the share of each taxel (its fraction of the force), and weights that the iteration
  tries.
- `LOGARITHM`: logarithms of the Gaussian weights with which the iteration starts.
- `ACROSS`, `UP`: offsets [kernel widths] of the taxels from the point of the force, in two directions along
  the skin.
- `_NUMBERS`: six sums over the taxels, which the iteration needs."""
ROWS = 6


def width(areas: Array) -> float:
    """Returns the width [m] (standard deviation) over which a contact force is distributed on a skin with
    taxels of `areas` (n,) [m2].

    The width combines the width `SIGMA` of the skin's cover and the size of a taxel.
    """
    return float(np.sqrt(SIGMA**2 + np.mean(areas) / 12.0))


def spread(positions: Array, point: Array, normal: Array, sigma: float) -> Array:
    """Returns the fraction (n,) of a contact force that each of n taxels gets (its share).

    The force acts at `point` (3,) [m], the taxels are at `positions` (n, 3) [m]. Shares are at least 0, and
    their sum is 1. The mean position of the taxels, weighted by their shares, is at `point`, apart from an
    offset along the skin's `normal` (3,). The error is at most a few percent of `sigma` if taxels surround
    the point. For a point beyond the skin's edge, the weighted mean is at the edge. The shares are local
    maximum-entropy weights (Arroyo and Ortiz 2006, doi:10.1002/nme.1534): those of a Gaussian of width
    `sigma` [m], corrected so that the weighted mean is right.
    """
    n = len(positions)
    near, work = np.empty(n, dtype=np.int64), np.empty((ROWS, max(n, 8)))
    count = _spread(np.ascontiguousarray(positions), np.arange(n), point, normal, sigma, near, work)
    shares = np.zeros(n)
    shares[near[:count]] = work[SHARE, :count]
    return shares


@inlined
def _exponential(x: float) -> float:
    """Returns exp(x) for x from -60 to 0, with a relative error of 1e-11. For a smaller x the result is
    exp(-60).

    The function has no branch, so the compiler can vectorise a loop around it.
    """
    x = (x if x > _LEAST else _LEAST) * 0.00390625
    y = 1.0 + x * (1.0 / 7.0) * (1.0 + x * (1.0 / 8.0) * (1.0 + x * (1.0 / 9.0)))
    y = 1.0 + x * (1.0 / 4.0) * (1.0 + x * (1.0 / 5.0) * (1.0 + x * (1.0 / 6.0) * y))
    y = 1.0 + x * (1.0 + x * (1.0 / 2.0) * (1.0 + x * (1.0 / 3.0) * y))
    for _ in range(8):
        y *= y
    return y


@inlined
def _weigh(u: float, v: float, count: int, work: Array, row: int) -> float:
    """Computes trial weights of `count` taxels, and writes them into the row `row` of the work space `work`
    (see `SHARE`).

    The weight of a taxel is exp(l + u a + v b), scaled so that the largest is 1; its logarithm l and offset
    (a, b) [kernel widths] are in `work`. Also writes six sums over the taxels into `work`: of w, w a, w b, w
    a^2, w a b and w b^2, for weights w. Returns the value that the best u and v minimise.
    """
    weights, logarithms, across, up = work[row], work[LOGARITHM], work[ACROSS], work[UP]
    top = 0.0
    if u != 0.0 or v != 0.0:
        top = -np.inf
        for i in range(count):
            weights[i] = logarithms[i] + across[i] * u + up[i] * v
            top = weights[i] if weights[i] > top else top
        for i in range(count):
            weights[i] = _exponential(weights[i] - top)
    else:
        for i in range(count):
            weights[i] = _exponential(logarithms[i])
    total = x = y = xx = xy = yy = 0.0
    for i in range(count):
        a, b, w = across[i], up[i], weights[i]
        total += w
        x += w * a
        y += w * b
        xx += w * a * a
        xy += w * a * b
        yy += w * b * b
    sums = work[_NUMBERS]
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5] = total, x, y, xx, xy, yy
    return top + np.log(total) + 0.5 * _SOFTNESS * (u * u + v * v)


@inlined
def _centre(count: int, work: Array) -> None:
    """Computes the shares of `count` taxels in a contact force, and writes them into the row `SHARE` of
    `work`. The mean position of the taxels, weighted by the shares, is then near the point of the force. The
    rows `LOGARITHM`, `ACROSS` and `UP` of `work` must be filled before.
    """
    tilt_u = tilt_v = 0.0
    row, other = SHARE, _TRIAL
    value = _weigh(tilt_u, tilt_v, count, work, row)
    sums = work[_NUMBERS]
    total = sums[0]
    for _ in range(_STEPS):
        total = sums[0]
        x, y = sums[1] / total, sums[2] / total
        g, h = x + _SOFTNESS * tilt_u, y + _SOFTNESS * tilt_v
        if g * g + h * h < _TOLERANCE**2:
            break
        xx = sums[3] / total - x * x + _SOFTNESS
        xy = sums[4] / total - x * y
        yy = sums[5] / total - y * y + _SOFTNESS
        determinant = xx * yy - xy * xy
        u, v = (xy * h - yy * g) / determinant, (xy * g - xx * h) / determinant
        slope = g * u + h * v
        size, better, trial = 1.0, False, value
        while size > 1e-6 and not better:
            trial = _weigh(tilt_u + size * u, tilt_v + size * v, count, work, other)
            better = trial <= value + 1e-4 * size * slope
            size /= 2.0
        if not better:
            break
        tilt_u += 2.0 * size * u
        tilt_v += 2.0 * size * v
        value, row, other, total = trial, other, row, sums[0]
    for i in range(count):
        work[SHARE, i] = work[row, i] / total


@inlined
def share_into(positions: Array, near: Array, point: Array, normal: Array, sigma: float, work: Array) -> None:
    """Writes the fraction (share) of a contact force that each of the taxels `near` (k,) gets into the row
    `SHARE` of `work`. The force acts at `point` (3,) [m] and is distributed over the width `sigma` [m].
    Before, `within` must have found these taxels with the same `work`."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    # Perpendicular to the normal and to the axis that is least parallel to it.
    if x <= y and x <= z:
        a, b, c = 0.0, normal[2], -normal[1]
    elif y <= z:
        a, b, c = -normal[2], 0.0, normal[0]
    else:
        a, b, c = normal[1], -normal[0], 0.0
    size = 1.0 / (sigma * (a * a + b * b + c * c) ** 0.5)
    a, b, c = a * size, b * size, c * size
    d, e, f = normal[1] * c - normal[2] * b, normal[2] * a - normal[0] * c, normal[0] * b - normal[1] * a
    px, py, pz = point[0], point[1], point[2]
    for k in range(len(near)):
        i = near[k]
        x, y, z = positions[i, 0] - px, positions[i, 1] - py, positions[i, 2] - pz
        work[ACROSS, k] = x * a + y * b + z * c
        work[UP, k] = x * d + y * e + z * f
    _centre(len(near), work)


@inlined
def within(
    positions: Array, among: Array, point: Array, sigma: float, reach: float, near: Array, work: Array
) -> tuple[int, float]:
    """Finds the taxels near `point` (3,) [m], among the taxels with the indices `among` (k,). `positions` (n,
    3) [m] are the positions of all taxels.

    A taxel counts as near if it is at most `reach` times `sigma` [m] farther from the point than the nearest
    taxel. Writes the indices of the near taxels into `near`, and the logarithms of their Gaussian weights
    into `work`. Returns the number of near taxels, and the distance of the nearest taxel divided by `sigma`.
    """
    least, scale = np.inf, 1.0 / (sigma * sigma)
    px, py, pz = point[0], point[1], point[2]
    squares = work[_TRIAL]
    for k in range(len(among)):
        i = among[k]
        x, y, z = positions[i, 0] - px, positions[i, 1] - py, positions[i, 2] - pz
        squares[k] = (x * x + y * y + z * z) * scale
        least = min(least, squares[k])
    nearest = least**0.5
    limit, count = (nearest + reach) ** 2, 0
    for k in range(len(among)):
        near[count] = among[k]
        work[LOGARITHM, count] = -0.5 * (squares[k] - least)
        count += squares[k] <= limit
    return count, nearest


@compiled(
    int64(reads(2), reads(1, int64), views(1), views(1), float64, writes(1, int64), writes(2)), seldom=True
)
def _spread(
    positions: Array, among: Array, point: Array, normal: Array, sigma: float, near: Array, work: Array
) -> int:
    count, _ = within(positions, among, point, sigma, REACH, near, work)
    share_into(positions, near[:count], point, normal, sigma, work)
    return int(count)
