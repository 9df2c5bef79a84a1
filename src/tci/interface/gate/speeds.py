"""Speeds of joints, also of those whose robot does not measure them."""

from __future__ import annotations

import numpy as np

from tci.frames import Array
from tci.interface.kernels.motion import all_finite
from tci.messages import JointReading

SMOOTHING = 0.05
"""Time [s] over which successive angles tell a speed. Ours."""


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
