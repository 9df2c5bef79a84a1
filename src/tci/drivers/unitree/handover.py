"""Handover of a robot's motors: from its own controller to TCI and back, without a step.

Over rt/arm_sdk the robot mixes set-points by a weight: it rises from 0 at the measured posture, and falls
while the targets stay. Over rt/lowcmd no other controller takes the motors back: the stiffness rises at the
beginning, and at the end the motors are damped.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.drivers.unitree.motors import MOTORS
from tci.frames import Array

TAKE = 1.0
"""Time [s] in which weight or stiffness rises. Assumed: the shortest that the vendor's examples use."""
GIVE = 2.0
"""Time [s] in which the weight falls. Assumed: arms of 4 kg then sink without a swing."""
DAMPED = 0.2
"""Time [s] of damping at the end of rt/lowcmd. Assumed: joints come to rest in this time."""
DAMPING = 2.0
"""Gain [N m s/rad] of this damping. Assumed: twice that of the vendor's examples for arms."""
QUIET = 0.1
"""Time [s] without new targets after which velocities and torques end. Assumed: equal to the largest age of a
state."""
LONGEST = 0.02
"""Largest time [s] by which one step advances, so that a process that did not run for a while causes no jump.
Assumed: five periods."""
LEFT = 0.1
"""Increase [rad] of a motor's distance from its target, while no states arrived, from which the motor counts
as having left the target. Assumed: the motion in 0.2 s of the handover if the controller's own posture is 1
rad away."""
ROWS = 5
Q, DQ, TAU, KP, KD = range(ROWS)
"""Rows of targets (5, 29): angle, velocity, torque and gains of each motor."""


class Phase(IntEnum):
    """Owner of the motors."""

    WAITING = 0
    """The robot's own controller has the motors; nothing is sent."""
    TAKING = 1
    """The weight rises; targets stay at the posture of its beginning."""
    LEADING = 2
    """TCI has the motors; they follow targets."""
    GIVING = 3
    """The weight falls; targets stay."""


class Handover:
    """Weight and targets of the motors. Time comes from the caller."""

    def __init__(self, gains: Array, *, whole: bool) -> None:
        """Takes the gains (2, 29) of full stiffness and damping; `whole` for rt/lowcmd."""
        self.phase = Phase.WAITING
        self.weight = 0.0
        """Weight (0..1) of TCI's targets; over rt/lowcmd, fraction of the stiffness."""
        self._gains, self._whole = gains, whole
        self._goal = np.zeros((ROWS, MOTORS))
        self._now = self._told = 0.0
        self._pushed = np.zeros(MOTORS, dtype=bool)

    def take(self, posture: Array, now: float) -> None:
        """Begins with the motors at `posture` (29,) [rad] at `now` [s], if the robot has them itself."""
        if self.phase is Phase.WAITING:
            self.phase, self.weight = Phase.TAKING, 0.0
            self._goal[Q], self._goal[DQ:KP], self._goal[KP:] = posture, 0.0, self._gains
            self._pushed[:] = False
            self._now = self._told = now

    def resume(self, goal: Array, weight: float, now: float) -> None:
        """Begins to hand back motors that another process held: targets (5, 29) and their `weight`."""
        self.phase, self.weight = Phase.LEADING, weight
        self._goal[:] = goal
        self._now = self._told = now
        self.give()

    def follow(self, chosen: NDArray[np.bool_], targets: Array, posture: Array, now: float) -> None:
        """Takes targets (5, 29) of the `chosen` motors (29,); the others stay.

        A motor under a torque that is no longer chosen keeps its angle in `posture` (29,) [rad].
        """
        if self.phase is not Phase.LEADING:
            return
        left = self._pushed & ~chosen
        self._goal[Q, left] = posture[left]
        self._goal[KP:, left] = self._gains[:, left]
        self._goal[DQ:KP, ~chosen] = 0.0
        self._goal[:, chosen] = targets[:, chosen]
        self._pushed = chosen & (targets[TAU] != 0.0)
        self._told = now

    def give(self) -> None:
        """Begins to hand the motors back, from the present weight; targets stay."""
        if self.phase in (Phase.TAKING, Phase.LEADING):
            self.phase = Phase.GIVING
            if self._whole:
                self.weight = 1.0  # counts the time of damping

    def give_unseen(self, before: Array, posture: Array) -> None:
        """Begins to hand back the motors of a robot whose posture changed from `before` to `posture` (29,)
        [rad] while no states arrived.

        For a motor that has left its target, the new target is its present angle, because the old target
        would cause a step. Other targets stay, since a loaded motor is always at a small distance from its
        target.
        """
        self.give()
        goal = self._goal[Q]
        left = np.abs(posture - goal) > np.abs(before - goal) + LEFT
        goal[left] = posture[left]

    def step(self, now: float) -> Array:
        """Returns the targets (5, 29) to send at `now` [s]."""
        elapsed = min(max(now - self._now, 0.0), LONGEST)
        self._now = now
        if self.phase is Phase.TAKING:
            self.weight = min(1.0, self.weight + elapsed / TAKE)
            if self.weight >= 1.0:
                self.phase, self._told = Phase.LEADING, now
        elif self.phase is Phase.GIVING:
            self.weight = max(0.0, self.weight - elapsed / (DAMPED if self._whole else GIVE))
            if self.weight <= 0.0:
                self.phase = Phase.WAITING
        sent = self._goal.copy()
        if self.phase is not Phase.LEADING or now - self._told > QUIET:
            sent[DQ:KP] = 0.0
            sent[KD] = np.maximum(sent[KD], self._gains[1])
        if self._whole and self.phase is Phase.TAKING:
            sent[KP] *= self.weight
        elif self._whole and self.phase is not Phase.LEADING:
            sent[KP], sent[KD] = 0.0, DAMPING
        return sent
