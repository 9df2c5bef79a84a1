"""Handover of a robot's motors: from its own controller to TCI and back, without a step.

Over rt/arm_sdk the robot mixes set-points by a weight: it rises from 0 at the measured posture, and falls
while the targets stay. Over rt/lowcmd there is nobody to hand back to: the stiffness rises, and the end is
damping.
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
"""Time [s] of damping at the end of rt/lowcmd. Assumed: joints come to rest in it."""
DAMPING = 2.0
"""Gain [N m s/rad] of that damping. Assumed: twice the vendor's examples for arms."""
QUIET = 0.1
"""Time [s] without new targets after which velocities and torques end. Assumed: as old as a state may be."""
LONGEST = 0.02
"""Largest time [s] that one step counts for: a process that stood still does not jump. Assumed: five
periods."""
LEFT = 0.1
"""Distance [rad] by which a motor that was unseen is farther from its target, if it has left it. Assumed: a
robot that obeys goes so far in 0.2 s of the fade if its own posture is 1 rad away."""
ROWS = 5
Q, DQ, TAU, KP, KD = range(ROWS)
"""Rows of targets (5, 29): angle, velocity, torque and gains of each motor."""


class Phase(IntEnum):
    """Owner of the motors."""

    WAITING = 0
    """The robot's own controller; nothing is sent."""
    TAKING = 1
    """The weight rises; targets stay at the posture of its beginning."""
    LEADING = 2
    """TCI; targets are followed."""
    GIVING = 3
    """The weight falls; targets stay."""


class Handover:
    """Weight and targets of the motors. Time comes from the caller."""

    def __init__(self, gains: Array, *, whole: bool) -> None:
        """Takes the gains (2, 29) of full stiffness and damping; `whole` for rt/lowcmd."""
        self.phase = Phase.WAITING
        self.weight = 0.0
        """Share (0..1) of TCI's targets; over rt/lowcmd that of the stiffness."""
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

        A motor under a torque that is no longer chosen stays at its place in `posture` (29,) [rad].
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
        """Begins to hand back the motors of a robot that went unseen from `before` to `posture` (29,) [rad].

        The target of a motor that has left it is where that motor is: the old one would be a step. Those of
        the others stay, since a motor lies beside its target by as much as its load bends it.
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
