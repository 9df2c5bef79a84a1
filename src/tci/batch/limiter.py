"""Set-points of many worlds that keep the limits of position, velocity, acceleration and jerk, and reach
their targets as fast as these allow. The gate of a single robot does the same with ruckig, which plans for
a few servos at a time; a policy that was trained here still goes through that gate on a robot."""

from __future__ import annotations

import numpy as np
from numba import float64, int64
from numpy.typing import NDArray

from tci.batch import formulas
from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, views, writes
from tci.support.one_source import made_with

PIECES = 8
"""Pieces of constant jerk of a motion, see `formulas`."""
_f = made_with(inlined, formulas)
_side, _rise, _hold, _fall = _f.side_of, _f.rise_of, _f.hold_of, _f.fall_of
_is_eased, _ease, _speed, _over = _f.is_eased, _f.ease_of, _f.speed_of, _f.over_peak


@inlined
def _change(
    v: float, a: float, end: float, most: float, jerk: float, sign: float, first: int, times: Array,
    jerks: Array,
) -> None:  # fmt: skip
    """Writes the three pieces of a change of speed, from the piece `first` on."""
    side = _side(v, a, end, jerk)
    times[first], jerks[first] = _rise(v, a, end, most, jerk), sign * side * jerk
    times[first + 1] = _hold(v, a, end, most, jerk)
    times[first + 2], jerks[first + 2] = _fall(v, a, end, most, jerk), -sign * side * jerk


@inlined
def _plan(
    state: Array, target: float, fastest: float, most: float, jerk: float, times: Array, jerks: Array
) -> None:
    """Writes duration [s] and jerk of all pieces of the fastest motion from `state` (3,) to rest at
    `target`."""
    sign = -1.0 if state[2] > 0.0 else 1.0
    d, v, a = sign * (target - state[0]), sign * state[1], sign * state[2]
    for k in range(PIECES):
        times[k] = jerks[k] = 0.0
    if _is_eased(d, v, a, most, jerk):
        eased = _ease(d, v, a, most, jerk)
        t = (eased - a) / jerk
        times[0], jerks[0] = t, sign * jerk
        _change(v + t * (a + t * jerk / 2.0), eased, 0.0, most, jerk, sign, 1, times, jerks)
        return
    peak = _speed(d, v, a, fastest, most, jerk)
    _change(v, a, peak, most, jerk, sign, 1, times, jerks)
    if abs(peak) > 0.5 * fastest:
        times[4] = max((d - _over(v, a, peak, most, jerk)) / peak, 0.0)
    _change(peak, 0.0, 0.0, most, jerk, sign, 5, times, jerks)


@compiled(int64(float64, views(2), reads(2), writes(2), writes(3), writes(3), writes(3), writes(2)))
def advance(
    period: float, wanted: Array, limits: Array, goals: Array, states: Array, times: Array, jerks: Array,
    sent: Array,
) -> int:  # fmt: skip
    """Moves all set-points on by one period. Returns how many motions were planned anew.

    Args:
        period: Time [s].
        wanted: Targets (N, n) [rad], which may lie outside the limits.
        limits: Lower, upper, velocity, acceleration and jerk (5, n); a servo without them stays where it is.
        goals: Targets (N, n) [rad] of the present motions.
        states: Set-points, their velocities and accelerations (N, n, 3).
        times: What is left [s] of each piece (N, n, 8) of the motions.
        jerks: Their jerks (N, n, 8).
        sent: Output (N, n): set-points [rad].
    """
    planned = 0
    lower, upper, velocity, acceleration, jerk = limits[0], limits[1], limits[2], limits[3], limits[4]
    for w in range(len(wanted)):
        for i in range(len(lower)):
            state, left, own = states[w, i], times[w, i], jerks[w, i]
            if jerk[i] > 0.0 and wanted[w, i] == wanted[w, i]:
                target = min(max(wanted[w, i], lower[i]), upper[i])
                if target != goals[w, i]:
                    _plan(state, target, velocity[i], acceleration[i], jerk[i], left, own)
                    goals[w, i] = target
                    planned += 1
            time, rests = period, True
            for k in range(PIECES):
                if left[k] <= 0.0:
                    continue
                t = min(time, left[k])
                p, v, a, j = state[0], state[1], state[2], own[k]
                state[0] = p + t * (v + t * (a / 2.0 + t * j / 6.0))
                state[1] = v + t * (a + t * j / 2.0)
                state[2] = a + t * j
                left[k] -= t
                time -= t
                if time <= 0.0:
                    rests = False
                    break
            if rests:
                state[0], state[1], state[2] = goals[w, i], 0.0, 0.0
            sent[w, i] = state[0]
    return planned


class BatchLimiter:
    """Set-points of N worlds within the limits of n servos."""

    def __init__(self, limits: Array, start: Array, *, period: float) -> None:
        """Rests at `start` (N, n) [rad], with the `limits` (5, n) of a `BatchScene`; a step takes `period`
        [s]."""
        self._limits = np.ascontiguousarray(limits)
        self._period = period
        self._goals = np.array(start, dtype=float)
        self.states = np.zeros((*start.shape, 3))
        """Set-point [rad], velocity [rad/s] and acceleration [rad/s2] (N, n, 3)."""
        self.states[:, :, 0] = start
        self._times, self._jerks = np.zeros((2, *start.shape, PIECES))
        self.sent = self._goals.copy()
        """Set-points (N, n) [rad]."""

    @property
    def goals(self) -> Array:
        """Where the present motions end (N, n) [rad]."""
        return self._goals

    @property
    def rests(self) -> Array:
        """True (N, n) for each servo that has arrived."""
        arrived: Array = (self.states[:, :, 1:] == 0.0).all(axis=2) & (self.states[:, :, 0] == self._goals)
        return arrived

    @property
    def remaining(self) -> Array:
        """Time (N, n) [s] until each servo arrives."""
        time: Array = self._times.sum(axis=2)
        return time

    def step(self, wanted: Array) -> Array:
        """Moves on towards the targets `wanted` (N, n) [rad], clipped to the limits; NaN keeps the last
        one. Returns `sent`."""
        advance(
            self._period, wanted, self._limits, self._goals, self.states, self._times, self._jerks, self.sent
        )
        return self.sent

    def reset(self, worlds: NDArray[np.intp], start: Array) -> None:
        """Puts the set-points of some `worlds` (k,) at `start` (k, n) [rad], at rest."""
        self._goals[worlds] = self.sent[worlds] = start
        self.states[worlds] = 0.0
        self.states[worlds, :, 0] = start
        self._times[worlds] = 0.0
