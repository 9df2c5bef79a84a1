"""Joint speeds, measured or estimated from successive angles."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from tci.gate.joint_monitor import Reference
from tci.gate.kernels.motion import all_finite
from tci.messages import JointReading
from tci.messages.frames import Array

SMOOTHING = 0.05
"""Time constant [s] of the smoothed speed that is estimated from successive angles. Assumed: with a shorter
time constant, the resolution of an encoder looks like a speed; with a longer time constant, a motion is
reported later."""

SPAN = 0.02
"""Longest time [s] between two readings from which a mean speed is computed. Assumed: over a longer time, the
motion between the readings is unknown; over a much shorter time, the resolution of an encoder looks like a
speed."""


class Slope:
    """Stores the latest readings and computes mean speeds from their angles."""

    def __init__(self, count: int) -> None:
        self._past: deque[JointReading] = deque()
        self._none = np.full(count, np.nan)
        self.span = 0.0
        """Time [s] between the oldest stored reading and the latest reading: the speeds are means over this
        time."""

    def step(self, joints: JointReading) -> None:
        """Stores the latest reading, and deletes readings that are too old."""
        past = self._past
        past.append(joints)
        while not 0.0 <= joints.stamp - past[0].stamp <= SPAN:
            past.popleft()
        self.span = joints.stamp - past[0].stamp

    @property
    def speed(self) -> Array:
        """Returns the mean speeds (n,) [rad/s] between the oldest reading of the last 0.02 s (`SPAN`) and the
        latest reading. All speeds are NaN if there is no earlier reading in this time."""
        if not self.span > 0.0:
            return self._none
        speed: Array = (self._past[-1].position - self._past[0].position) / self.span
        return speed


class Speeds:
    """Estimates speeds from successive angles, for robots that do not measure speeds. Stores the latest
    estimates."""

    def __init__(self, count: int) -> None:
        self._guess = np.zeros(count)
        self._before: JointReading | None = None

    def step(self, joints: JointReading) -> Array:
        """Returns the speeds (n,) [rad/s] at a new reading. If the measured speed of a servo is NaN, its
        speed is estimated."""
        before, self._before = self._before or joints, joints
        if all_finite(joints.velocity):
            self._guess = joints.velocity
            return joints.velocity
        passed = joints.stamp - before.stamp
        if passed > 0.0:
            share = passed / (passed + SMOOTHING)
            slope = (joints.position - before.position) / passed
            self._guess = (1.0 - share) * self._guess + share * slope
        return np.where(np.isfinite(joints.velocity), joints.velocity, self._guess)


class Lags:
    """Estimates by how long each joint lags behind its reference, as the gate sees it: with its servo, the
    wire both ways, and the age of readings."""

    FADES = 0.2
    """Time constant [s] with which earlier motion is forgotten."""
    LONGEST = 0.1
    """Longest lag [s] of a healthy joint, as in `MonitorSettings.lag`. What is farther behind is held."""

    def __init__(self, count: int) -> None:
        self._behind, self._moved = np.zeros(count), np.full(count, 1e-9)
        self._stamp = -np.inf

    def step(self, joints: JointReading, reference: Reference) -> None:
        """A new reading, and the reference that was valid when it came."""
        passed, self._stamp = joints.stamp - self._stamp, joints.stamp
        keeps = np.exp(-passed / self.FADES) if passed > 0.0 else 0.0
        speed = np.zeros(len(self._behind))
        behind = np.zeros(len(self._behind))
        speed[reference.servos] = reference.velocity
        behind[reference.servos] = reference.position - joints.position[reference.servos]
        # least squares of behind = lag * speed: an angle that stays off, as under weight, counts little
        self._behind = keeps * self._behind + behind * speed
        self._moved = np.maximum(keeps * self._moved + speed * speed, 1e-9)

    def of(self, servos: Sequence[int]) -> float:
        """Longest lag [s] of some servos; 0 of those that have not moved."""
        lag = self._behind[list(servos)] / self._moved[list(servos)]
        return float(np.clip(lag, 0.0, self.LONGEST).max(initial=0.0))
