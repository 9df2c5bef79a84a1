"""Speeds of joints, also of those whose robot does not measure them."""

from __future__ import annotations

from collections import deque

import numpy as np

from tci.frames import Array
from tci.gate.kernels.motion import all_finite
from tci.messages import JointReading

SMOOTHING = 0.05
"""Time [s] over which successive angles tell a speed. Ours."""

SPAN = 0.02
"""Longest time [s] between two readings whose angles tell a speed together. Assumed: more hides how a joint
went in between, and an encoder's step in less is no speed."""


class Slope:
    """Mean speeds that angles tell, over the latest readings. It has memory."""

    def __init__(self, count: int) -> None:
        self._past: deque[JointReading] = deque()
        self._none = np.full(count, np.nan)
        self.span = 0.0
        """Time [s] until the latest reading for which they are the mean."""

    def step(self, joints: JointReading) -> None:
        """The latest reading."""
        past = self._past
        past.append(joints)
        while not 0.0 <= joints.stamp - past[0].stamp <= SPAN:
            past.popleft()
        self.span = joints.stamp - past[0].stamp

    @property
    def speed(self) -> Array:
        """Speeds (n,) [rad/s]; NaN where readings come too seldom to tell."""
        if not self.span > 0.0:
            return self._none
        speed: Array = (self._past[-1].position - self._past[0].position) / self.span
        return speed


class Speeds:
    """Guesses from successive angles what a robot does not measure. It has memory."""

    def __init__(self, count: int) -> None:
        self._guess = np.zeros(count)
        self._before: JointReading | None = None

    def step(self, joints: JointReading) -> Array:
        """Speeds (n,) [rad/s] at a new reading: measured, or guessed where the reading says NaN."""
        before, self._before = self._before, joints
        if all_finite(joints.velocity):
            self._guess = joints.velocity
            return joints.velocity
        passed = 0.0 if before is None else joints.stamp - before.stamp
        if before is not None and passed > 0.0:
            share = passed / (passed + SMOOTHING)
            slope = (joints.position - before.position) / passed
            self._guess = (1.0 - share) * self._guess + share * slope
        return np.where(np.isfinite(joints.velocity), joints.velocity, self._guess)
