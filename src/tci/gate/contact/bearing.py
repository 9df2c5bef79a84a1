"""Which joints bear more than a moment ago, by their measured torques: the earliest sign of a contact.

While all references cruise, a robot's own motion changes torques slowly. So what a joint bears more comes
from outside, long before a stiff servo is bent by degrees.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from tci.gate.contact.weights import longest_levers
from tci.gate.joint_monitor import Reference
from tci.messages import JointReading, Mode
from tci.messages.frames import Array
from tci.robot.description import Robot

BARE = 30.0
"""Force [N] at the end of the arm that counts, without skin."""
SHARE = 0.2
"""Fraction of its torque limit by which a joint must bear more at least. Dry friction is 5 %, and healthy
robots of rigid bodies with wrong masses came to a tenth of what counts."""
MOMENT = 0.15
"""Length [s] of the moment: a weight's lever changes little meanwhile."""
ONSET = 0.1
"""Time [s] within which a contact that is noticed now began: torques of later tell of it already."""
EVEN = 1e-4
"""Change [rad/s] of a velocity reference in one period that is none."""


class Bearing:
    """Compares measured torques with those of a moment ago."""

    def __init__(self, robot: Robot, *, known: bool) -> None:
        """`known`: readings are so regular that it is known when joints accelerate."""
        self._known = known
        levers = longest_levers(robot)
        limits = np.array([servo.limits.torque or np.inf for servo in robot.servos])
        self.least = np.where(levers > 0.0, np.maximum(SHARE * limits, BARE * levers), np.inf)
        """Torque (n_servos,) [N m] beyond which what a joint bears more comes from outside."""
        self._velocity = np.zeros(0)
        self._modes: tuple[Mode, ...] = ()
        self._loose, self._asked = np.zeros(0, bool), np.zeros(0, np.intp)
        self._torques: deque[tuple[float, Array]] = deque()
        self.forget()

    def forget(self) -> None:
        self._uneven = -np.inf
        self._torques.clear()

    def remember(self, reference: Reference, now: float) -> None:
        """Notes whether the references cruise at `now` [s]."""
        before, self._velocity = self._velocity, reference.velocity
        if before.shape != self._velocity.shape or np.abs(self._velocity - before).max(initial=0.0) > EVEN:
            self._uneven = now
        if reference.modes != self._modes:
            self._modes = reference.modes
            self._loose = np.array([mode is Mode.TORQUE for mode in reference.modes], bool)
        self._asked = reference.servos[self._loose]

    @property
    def before(self) -> Array | None:
        """Torques (n_servos,) [N m] before a contact that is noticed now; None if joints accelerated then."""
        torques = self._torques
        return torques[0][1] if torques and torques[-1][0] - torques[0][0] > ONSET else None

    def beyond(self, torque: Array | None, before: Array | None) -> Array:
        """By how much `torque` (n_servos,) is away from `before`, as multiples of what comes from outside; 0
        where one is unknown."""
        if torque is None or before is None:
            return np.zeros(len(self.least))
        found: Array = (torque - before) / self.least
        found[np.isnan(found)] = 0.0
        return found

    def more(self, joints: JointReading, lag: float) -> Array:
        """What each joint bears more than a moment ago (n_servos,), as multiples of what comes from outside;
        0 while a joint that lags by `lag` [s] may still accelerate, and without measured torques."""
        if joints.torque is None or not self._known or joints.stamp - self._uneven <= lag:
            self._torques.clear()
        else:
            self._torques.append((joints.stamp, joints.torque))
            while joints.stamp - self._torques[0][0] > MOMENT:
                self._torques.popleft()
        found = self.beyond(joints.torque, self._torques[0][1] if self._torques else None)
        found[self._asked] = 0.0  # somebody asks for these torques
        return found
