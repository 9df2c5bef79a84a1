"""The jerk-limited motion of joints from rest to rest, in closed form (Kroeger 2011; Berscheid and Kroeger
2021).

Seven phases of constant jerk: the joint accelerates to a peak speed within a ramp, cruises, and slows down in
the mirror image of the ramp. Ruckig plans the same motions from any state. Here a motion always starts and
ends at rest, so that a few formulas are enough, and a touch needs no planner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, record, writes

EARLY = (0.01, 0.02)
"""The path of a motion is predicted first at these times [s] after its beginning. A path may begin in a
direction in which it does not end, because the joints accelerate differently."""
SHARES = (0.25, 0.5, 0.75, 1.0)
"""After the times EARLY, the path of a motion is predicted at these fractions of its duration."""
TIMES = len(EARLY) + len(SHARES)
_NEWTON_STEPS = 12
"""Newton's method doubles the correct digits in each step, and starts with at least a third of one."""


class Speeds(NamedTuple):
    """Limits (k,) of k joints: velocity [rad/s], acceleration [rad/s2], jerk [rad/s3]."""

    velocity: Array
    acceleration: Array
    jerk: Array


@inlined
def _ramp(peak: float, a: float, j: float) -> float:
    """Time [s] from rest to the speed `peak` [rad/s]."""
    time: float = peak / a + a / j if peak * j >= a * a else 2.0 * np.sqrt(peak / j)
    return time


@inlined
def _duration(distance: float, peak: float, a: float, j: float) -> float:
    """Time [s] of a motion: on average, each ramp has half the peak speed."""
    time: float = _ramp(peak, a, j) + distance / peak if distance > 0.0 else 0.0
    return time


@inlined
def _fastest_peak(distance: float, v: float, a: float, j: float) -> float:
    """Peak speed [rad/s] of the fastest motion over `distance` [rad]: `v`, or less if the two ramps alone
    cover the distance."""
    if distance * j * j <= 2.0 * a * a * a:
        return min(v, (0.5 * distance * np.sqrt(j)) ** (2.0 / 3.0))
    lost = a * a / j
    return min(v, 0.5 * (np.sqrt(lost * lost + 4.0 * a * distance) - lost))


@inlined
def _peak_within(distance: float, time: float, a: float, j: float) -> float:
    """Peak speed [rad/s] of the motion over `distance` [rad] that takes `time` [s], longer than the fastest:
    the solution of `_duration(distance, peak) = time` with a cruise."""
    total = a * time - a * a / j
    square = total * total - 4.0 * a * distance
    if total > 0.0 and square >= 0.0:
        peak = 2.0 * a * distance / (total + np.sqrt(square))
        if peak * j >= a * a:
            return peak
    # the ramp has no phase of constant acceleration: 2 s^3 / sqrt(j) - time s^2 + distance = 0, peak = s^2
    root = np.sqrt(j)
    s = np.sqrt(distance / time)
    for _ in range(_NEWTON_STEPS):
        s -= (2.0 * s * s * s / root - time * s * s + distance) / (6.0 * s * s / root - 2.0 * time * s)
    return s * s


@inlined
def _travelled(t: float, distance: float, peak: float, a: float, j: float) -> float:
    """Distance [rad] travelled `t` [s] after the start of a motion over `distance` with the speed `peak`."""
    if not distance > 0.0:
        return distance  # 0, or NaN for an unknown angle
    left = _duration(distance, peak, a, j) - t
    if left <= 0.0:
        return distance
    return _begun(t, peak, a, j) if t <= left else distance - _begun(left, peak, a, j)


@inlined
def _begun(t: float, peak: float, a: float, j: float) -> float:
    """Distance [rad] travelled `t` [s] after the start, in the first half of a motion."""
    ramp = _ramp(peak, a, j)
    top = min(a, np.sqrt(peak * j))  # largest acceleration
    rise = top / j
    if t >= ramp:
        return peak * (t - 0.5 * ramp)
    if t < rise:
        return j * t * t * t / 6.0
    if t < ramp - rise:
        steady = t - rise
        return top * (rise * rise / 6.0 + 0.5 * rise * steady + 0.5 * steady * steady)
    left = ramp - t
    return peak * (0.5 * ramp - left) + j * left * left * left / 6.0


_SPEEDS = record(Speeds, reads(1), reads(1), reads(1))


@compiled(void(writes(2), reads(1, int64), reads(1), _SPEEDS, boolean))
def predict(way: Array, servos: NDArray[np.int64], goal: Array, most: Speeds, together: bool) -> None:
    """Writes the path of k servos from rest to rest into `way` (7, n).

    Args:
        way: Angles [rad] of all n servos: in row 0 at the start, and in the other rows the same angles, which
            become those at the times EARLY and at the fractions SHARES of the duration.
        servos: Indices (k,) of the servos that move.
        goal: Their final angles (k,) [rad].
        most: Their limits.
        together: True if the servos arrive at the same time; else each moves as fast as it can.
    """
    duration = 0.0
    for i in range(len(servos)):
        apart = abs(goal[i] - way[0, servos[i]])
        peak = _fastest_peak(apart, most.velocity[i], most.acceleration[i], most.jerk[i])
        duration = max(duration, _duration(apart, peak, most.acceleration[i], most.jerk[i]))
    for i in range(len(servos)):
        here, a, j = way[0, servos[i]], most.acceleration[i], most.jerk[i]
        apart, side = abs(goal[i] - here), 1.0 if goal[i] > here else -1.0
        peak = _fastest_peak(apart, most.velocity[i], a, j)
        if together and _duration(apart, peak, a, j) < duration:
            peak = _peak_within(apart, duration, a, j)
        for k in range(TIMES):
            t = EARLY[k] if k < len(EARLY) else SHARES[k - len(EARLY)] * duration
            way[1 + k, servos[i]] = here + side * _travelled(t, apart, peak, a, j)


@compiled(float64(reads(1), _SPEEDS))
def quickest(ways: Array, most: Speeds) -> float:
    """Greatest speed, in ways per second, of k servos with the `ways` (k,) [rad] that arrive together;
    infinite without servos."""
    found: float = np.inf
    for i in range(len(ways)):
        apart = max(abs(ways[i]), 1e-9)
        peak = _fastest_peak(apart, most.velocity[i], most.acceleration[i], most.jerk[i])
        found = min(found, peak / apart)
    return found
