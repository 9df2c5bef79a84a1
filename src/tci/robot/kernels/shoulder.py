"""The angles of a shoulder for a rotation of the upper arm: the second subproblem of Paden and Kahan (Murray,
Li and Sastry 1994, 3.3). Rotations beyond the limits are approached by damped least squares (Wampler 1986).
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import NamedTuple

from numba import boolean, float64, int64, void

from tci.messages.frames import Array
from tci.robot import formulas
from tci.robot.formulas import SIDEWAYS
from tci.support.compiled import compiled, inlined, reads, record, views, writes
from tci.support.one_source import made_with

Vector = tuple[float, float, float]
_turn = made_with(inlined, formulas).turned
SHORT = pi / 6.0
"""A command that turns no servo of a shoulder farther than this angle [rad] is a small change."""
STEPS = 20
"""Most steps towards a rotation beyond the limits: five are enough where no axes are nearly parallel."""
EFFORT = 0.003
"""What a square radian of turning a servo counts beside a square radian that the upper arm is off. Without it
an arm that hangs at its limit turns its shoulder's first and third joint by 70 degrees for one; elsewhere the
upper arm ends within 0.3 % of its way of the best place."""


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
    upper_arm: Array
    """Axes (3, 3) x, y and z of the upper arm in the torso frame, one per row."""
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
    turned: Vector = _turn(v[0], v[1], v[2], axis[0], axis[1], axis[2], angle)
    return turned


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


@inlined
def _solve_symmetric(rows: tuple[Vector, Vector, Vector], b: Vector) -> Vector:
    x, y, z = _cross(rows[1], rows[2]), _cross(rows[2], rows[0]), _cross(rows[0], rows[1])
    det = _dot(rows[0], x)
    return (
        (x[0] * b[0] + y[0] * b[1] + z[0] * b[2]) / det,
        (x[1] * b[0] + y[1] * b[1] + z[1] * b[2]) / det,
        (x[2] * b[0] + y[2] * b[1] + z[2] * b[2]) / det,
    )


@inlined
def _missing(R_TU: Array, shoulder: ShoulderArrays, q: Vector) -> Vector:
    """The rotation vector (3,) [rad], in the torso frame, from the upper arm at angles `q` to `R_TU`."""
    first, second, third = _vector(shoulder.axes[0]), _vector(shoulder.axes[1]), _vector(shoulder.axes[2])
    x, y, z, level = 0.0, 0.0, 0.0, -1.0
    for k in range(3):
        own = _turned(third, q[2], _vector(shoulder.upper_arm[k]))
        own = _turned(first, q[0], _turned(second, q[1], own))
        wanted = R_TU[0, k], R_TU[1, k], R_TU[2, k]
        turned = _cross(own, wanted)
        x, y, z, level = x + turned[0], y + turned[1], z + turned[2], level + _dot(own, wanted)
    size = sqrt(x * x + y * y + z * z)
    scale = atan2(size, level) / size if size > 1e-12 else 0.5
    return scale * x, scale * y, scale * z


@inlined
def _along_axes(shoulder: ShoulderArrays, q: Vector, turned: Vector) -> Vector:
    """How much of a rotation vector [rad] each joint does at angles `q`."""
    first, second, third = _vector(shoulder.axes[0]), _vector(shoulder.axes[1]), _vector(shoulder.axes[2])
    s1, s2 = _turned(first, q[0], second), _turned(first, q[0], _turned(second, q[1], third))
    return _dot(first, turned), _dot(s1, turned), _dot(s2, turned)


@inlined
def _within(q: Vector, shoulder: ShoulderArrays) -> Vector:
    a, b = shoulder.lower, shoulder.upper
    return min(max(q[0], a[0]), b[0]), min(max(q[1], a[1]), b[1]), min(max(q[2], a[2]), b[2])


@inlined
def _towards(gradient: float, q: float, lower: float, upper: float) -> bool:
    """False for a joint at a limit that would go beyond it."""
    return not ((q <= lower and gradient < 0.0) or (q >= upper and gradient > 0.0))


@inlined
def _approach(R_TU: Array, begin: Vector, near: Array, pull: float, shoulder: ShoulderArrays) -> Vector:
    """Angles within the limits at which the upper arm is as near to `R_TU` as it comes from `begin` (3,)
    [rad], while each servo is pulled back to `near` (3,) [rad] with `pull`, such as EFFORT."""
    first, second, third = _vector(shoulder.axes[0]), _vector(shoulder.axes[1]), _vector(shoulder.axes[2])
    a, b = _vector(shoulder.lower), _vector(shoulder.upper)
    q = begin
    for _ in range(STEPS):
        missing = _missing(R_TU, shoulder, q)
        s1, s2 = _turned(first, q[0], second), _turned(first, q[0], _turned(second, q[1], third))
        wanted = _along_axes(shoulder, q, missing)
        g = (
            wanted[0] - pull * (q[0] - near[0]),
            wanted[1] - pull * (q[1] - near[1]),
            wanted[2] - pull * (q[2] - near[2]),
        )
        f0, f1, f2 = True, True, True
        dq = g
        for _ in range(4):  # at most three joints are stopped, one after the other
            f0 = f0 and _towards(dq[0], q[0], a[0], b[0])
            f1 = f1 and _towards(dq[1], q[1], a[1], b[1])
            f2 = f2 and _towards(dq[2], q[2], a[2], b[2])
            h01 = _dot(first, s1) if f0 and f1 else 0.0
            h02 = _dot(first, s2) if f0 and f2 else 0.0
            h12 = _dot(s1, s2) if f1 and f2 else 0.0
            one = 1.0 + max(pull, 1e-4)  # parallel axes have no inverse
            dq = _solve_symmetric(
                ((one, h01, h02), (h01, one, h12), (h02, h12, one)),
                (g[0] if f0 else 0.0, g[1] if f1 else 0.0, g[2] if f2 else 0.0),
            )
        before = q
        q = (
            min(max(q[0] + dq[0], a[0]), b[0]),
            min(max(q[1] + dq[1], a[1]), b[1]),
            min(max(q[2] + dq[2], a[2]), b[2]),
        )
        if max(abs(q[0] - before[0]), abs(q[1] - before[1]), abs(q[2] - before[2])) < 1e-6:
            break
    return q


_SHOULDER = record(ShoulderArrays, reads(2), *[reads(1)] * 4, reads(2), *[reads(1)] * 2)


@compiled(int64(reads(2), _SHOULDER, writes(2)))
def solve(R_TU: Array, shoulder: ShoulderArrays, found: Array) -> int:
    """Writes the servo angles [rad] at which the upper arm has the rotation `R_TU` (3, 3) into the rows of
    `found` (2, 3), and returns their number: 1 or 2. Limits are not checked."""
    count: int = _solve(R_TU, shoulder, found)
    return count


@inlined
def _solve_near(R_TU: Array, near: Array, shoulder: ShoulderArrays, found: Array, best: Array) -> None:
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


@inlined
def _keep_inside(R_TU: Array, near: Array, shoulder: ShoulderArrays, best: Array) -> None:
    """Changes a solution `best` (3,) [rad] beyond the limits: the joints that don't end at their limits do
    what they can for those that do, from `near` (3,) [rad]. At least one asks for more than its limit, so
    that whoever clips it can tell that the arm does not get to `R_TU` (3, 3)."""
    clipped = _within(_vector(best), shoulder)
    if clipped == _vector(best):
        return
    a, b = _vector(shoulder.lower), _vector(shoulder.upper)
    q, without = _within(_vector(near), shoulder), _missing(R_TU, shoulder, clipped)
    for pull in (EFFORT, 0.0):  # effort alone may keep all joints a little before their limits
        q = _approach(R_TU, q, near, pull, shoulder)
        missing = _missing(R_TU, shoulder, q)
        if _dot(missing, missing) > _dot(without, without):
            continue
        more, stopped = _along_axes(shoulder, q, missing), False
        for i in range(3):
            stopped = stopped or not _towards(more[i], q[i], a[i], b[i])
        if not stopped:
            continue
        for i in range(3):
            if _towards(more[i], q[i], a[i], b[i]):
                best[i] = q[i]
            elif more[i] < 0.0:
                best[i] = min(best[i], a[i] + more[i])
            else:
                best[i] = max(best[i], b[i] + more[i])
        return


@compiled(void(reads(3), reads(1), _SHOULDER, boolean, writes(2), writes(2)))
def solve_near(
    R_TU: Array, near: Array, shoulder: ShoulderArrays, inside: bool, room: Array, best: Array
) -> None:
    """Writes for each of m rotations `R_TU` (m, 3, 3) the solution that violates the limits least, and of
    equal ones (to 1e-6 rad) the nearest to `near` (3,) [rad], into `best` (m, 3). A solution within SHORT of
    `near` wins in any case: an arm at a limit stays there, instead of turning its shoulder around for a few
    degrees. With `inside`, solutions beyond the limits are changed as `_keep_inside` says. `room` (2, 3) is
    overwritten."""
    for k in range(len(R_TU)):
        _solve_near(R_TU[k], near, shoulder, room, best[k])
        if inside:
            _keep_inside(R_TU[k], near, shoulder, best[k])


@compiled(boolean(views(2), reads(2), float64, _SHOULDER, float64, writes(3)))
def slopes(
    angles: Array, R_TM: Array, side: float, shoulder: ShoulderArrays, least: float, found: Array
) -> bool:
    """Writes the derivatives d generic / d servo at `angles` (p, 3) [rad] into `found` (p, 3, 3). False if
    the determinant of the generic joints' axes is below `least` in one posture.

    Both are axes in the torso frame: those of the servos are the generic ones times the derivative. `R_TM`
    (3, 3) is the rotation of the arm's mount; `side` is +1 on the left.
    """
    first, second, third = _vector(shoulder.axes[0]), _vector(shoulder.axes[1]), _vector(shoulder.axes[2])
    ahead = R_TM[0, 0], R_TM[1, 0], R_TM[2, 0]
    up = R_TM[0, 2], R_TM[1, 2], R_TM[2, 2]
    lead = -R_TM[0, 1], -R_TM[1, 1], -R_TM[2, 1]
    for k in range(len(angles)):
        q = _vector(angles[k])
        s2, s3 = _turned(first, q[0], second), _turned(first, q[0], _turned(second, q[1], third))
        own = _turned(second, q[1], _turned(third, q[2], _vector(shoulder.upper_arm[2])))
        z = _turned(first, q[0], own)
        x, y = _dot(ahead, z), _dot(up, z)
        pitch = 0.0 if sqrt(x * x + y * y) < SIDEWAYS else atan2(-x, y)
        # the axis of abduction is level with the mount, and square to the axis of pitch
        a, b = side * cos(pitch), side * sin(pitch)
        level = a * ahead[0] + b * up[0], a * ahead[1] + b * up[1], a * ahead[2] + b * up[2]
        last = -side * z[0], -side * z[1], -side * z[2]
        rows = _cross(level, last), _cross(last, lead), _cross(lead, level)
        det = _dot(lead, rows[0])
        if abs(det) < least:
            return False
        for i in range(3):
            found[k, i, 0] = _dot(rows[i], first) / det
            found[k, i, 1] = _dot(rows[i], s2) / det
            found[k, i, 2] = _dot(rows[i], s3) / det
    return True
