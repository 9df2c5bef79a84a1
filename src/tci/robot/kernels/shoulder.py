"""The angles of a shoulder for a rotation of the upper arm: the second subproblem of Paden and Kahan (Murray,
Li and Sastry 1994, 3.3)."""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import NamedTuple

from numba import int64, void

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, record, writes

Vector = tuple[float, float, float]
SHORT = pi / 6.0
"""A command that turns no servo of a shoulder farther than this angle [rad] is a small change."""


class ShoulderArrays(NamedTuple):
    """Three joints of a shoulder, with all servos at zero."""

    axes: Array
    """Axes (3, 3) a1, a2 and a3 in the torso frame, one per row."""
    aside: Array
    """a3 x a2 (3,)."""
    across: Array
    """a1 x a2 (3,)."""
    end_U: Array
    """a3 (3,) in the frame of the upper arm."""
    aside_U: Array
    """a3 x a2 (3,) in the frame of the upper arm."""
    lower: Array
    """Limits (3,) [rad]."""
    upper: Array


@inlined
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _vector(array: Array) -> Vector:
    return array[0], array[1], array[2]


@inlined
def _times(matrix: Array, v: Array) -> Vector:
    return _dot(_vector(matrix[0]), v), _dot(_vector(matrix[1]), v), _dot(_vector(matrix[2]), v)


@inlined
def _angle_about(axis: Vector, start: Vector, end: Vector) -> float:
    level = _dot(start, end) - _dot(axis, start) * _dot(axis, end)
    return atan2(_dot(axis, _cross(start, end)), level)


@inlined
def _turned(axis: Vector, angle: float, v: Vector) -> Vector:
    """Rodrigues' formula."""
    c, s = cos(angle), sin(angle)
    along = _dot(axis, v) * (1.0 - c)
    x, y, z = _cross(axis, v)
    return (
        c * v[0] + s * x + along * axis[0],
        c * v[1] + s * y + along * axis[1],
        c * v[2] + s * z + along * axis[2],
    )


@inlined
def _near_middle(angle: float, lower: float, upper: float) -> float:
    """The same angle within half a turn of the middle of its limits."""
    middle = 0.5 * (lower + upper)
    return middle + (angle - middle + pi) % (2.0 * pi) - pi


@inlined
def _solve(R_TU: Array, shoulder: ShoulderArrays, found: Array) -> int:
    first, second, third = _vector(shoulder.axes[0]), _vector(shoulder.axes[1]), _vector(shoulder.axes[2])
    across = shoulder.across
    end, end_aside = _times(R_TU, shoulder.end_U), _times(R_TU, shoulder.aside_U)
    along_first, along_second = _dot(first, end), _dot(second, third)
    between = _dot(first, second)
    square = 1.0 - between * between
    alpha = (along_first - between * along_second) / square
    beta = (along_second - between * along_first) / square
    rest = (1.0 - alpha * alpha - beta * beta - 2.0 * alpha * beta * between) / square
    gamma = sqrt(max(rest, 0.0))
    count = 2 if rest > 0.0 else 1
    for k in range(count):
        side = gamma if k == 0 else -gamma
        middle = (
            alpha * first[0] + beta * second[0] + side * across[0],
            alpha * first[1] + beta * second[1] + side * across[1],
            alpha * first[2] + beta * second[2] + side * across[2],
        )
        q1, q2 = _angle_about(first, middle, end), _angle_about(second, third, middle)
        left = _turned(second, -q2, _turned(first, -q1, end_aside))
        q3 = _angle_about(third, _vector(shoulder.aside), left)
        found[k, 0] = _near_middle(q1, shoulder.lower[0], shoulder.upper[0])
        found[k, 1] = _near_middle(q2, shoulder.lower[1], shoulder.upper[1])
        found[k, 2] = _near_middle(q3, shoulder.lower[2], shoulder.upper[2])
    return count


_SHOULDER = record(ShoulderArrays, reads(2), *[reads(1)] * 6)


@compiled(int64(reads(2), _SHOULDER, writes(2)))
def solve(R_TU: Array, shoulder: ShoulderArrays, found: Array) -> int:
    """Writes the servo angles [rad] at which the upper arm has the rotation `R_TU` (3, 3) into the rows of
    `found` (2, 3), and returns their number: 1 or 2. Limits are not checked."""
    count: int = _solve(R_TU, shoulder, found)
    return count


@compiled(void(reads(2), reads(1), _SHOULDER, writes(2), writes(1)))
def solve_near(R_TU: Array, near: Array, shoulder: ShoulderArrays, found: Array, best: Array) -> None:
    """Writes the solution that violates the limits least, and of equal ones (to 1e-6 rad) the nearest to
    `near` (3,) [rad], into `best` (3,). A solution within SHORT of `near` wins in any case: an arm at a limit
    stays there, instead of turning its shoulder around for a few degrees. `found` (2, 3) is room for all
    solutions."""
    chosen, worst, farthest = 0, 0.0, 0.0
    for k in range(_solve(R_TU, shoulder, found)):
        outside, apart, turned = 0.0, 0.0, 0.0
        for i in range(3):
            turned = max(turned, abs((found[k, i] - near[i] + pi) % (2.0 * pi) - pi))
        for i in range(3):
            if turned <= SHORT:
                found[k, i] = near[i] + (found[k, i] - near[i] + pi) % (2.0 * pi) - pi
            outside = max(outside, shoulder.lower[i] - found[k, i], found[k, i] - shoulder.upper[i])
            apart += (found[k, i] - near[i]) * (found[k, i] - near[i])
        outside = round(outside, 6) if turned > SHORT else -1.0
        if k == 0 or outside < worst or (outside == worst and apart < farthest):
            chosen, worst, farthest = k, outside, apart
    for i in range(3):
        best[i] = found[chosen, i]
