"""Which joints ran beyond their references and brake there: nothing holds these.

A motor at its torque limit can't brake sooner what it carries and what other joints throw at it. The joint
passes its reference, loses speed, and turns. One that somebody pushes there gains speed, and one that is held
there stays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.messages import JointReading
from tci.messages.frames import Array

BRAKING = 0.4
"""Longest time [s] in which it loses all its speed. A G1's waist that carries both arms took 0.25 s."""
TURNS = 0.05
"""Longest time [s] for which it stands until it comes back: it turns, and does not stay."""
STANDS = float(np.deg2rad(10.0))
"""Measured speed [rad/s] below which a joint stands."""


class Overshoots:
    """Remembers how fast each joint passed its reference."""

    def __init__(self, count: int) -> None:
        self._fast = np.zeros(count)  # when it passed [rad/s]
        self._times = np.full((3, count), -np.inf)
        self._passed, self._went, self._overshot = self._times  # when last [s]

    def forget(self) -> None:
        """After the clock went back."""
        self._times[:] = -np.inf

    def look(
        self, joints: JointReading, side: Array, passes: NDArray[np.bool_], way: Array
    ) -> NDArray[np.bool_]:
        """Notes a reading. Returns which joints brake beyond their references (n,).

        Args:
            joints: the reading.
            side: where each joint's reference is (n,): 1 at larger angles, -1 at smaller ones.
            passes: joints that are or passed where their references were a moment ago (n,).
            way: of each reference within that moment (n,) [rad]. What is thrown back against it hit
                something, unless it overshot before and swings.
        """
        leaves = -side * joints.velocity
        runs = passes & (leaves > 0.0) & ((-side * way > 0.0) | (joints.stamp - self._overshot < BRAKING))
        self._passed[passes] = np.where(runs, joints.stamp, -np.inf)[passes]
        self._fast[runs] = leaves[runs]
        self._went[np.abs(leaves) > STANDS] = joints.stamp
        left = np.maximum(1.0 - (joints.stamp - self._passed) / BRAKING, 0.0)
        brakes: NDArray[np.bool_] = (left > 0.0) & (leaves < left * self._fast)
        return brakes & (joints.stamp - self._went < TURNS)

    def note(self, far: NDArray[np.bool_], now: float) -> None:
        """Joints (n,) that are `far` beyond their references at `now` [s]."""
        self._overshot[far] = now

    def swing(self, now: float) -> NDArray[np.intp]:
        """Servos that were far beyond a moment before `now` [s], and may still swing."""
        return np.flatnonzero(now - self._overshot < BRAKING)
