"""Hands the control of a robot's motors from the robot's own controller to TCI and back, without a step in
position.

- Over rt/arm_sdk, the robot mixes TCI's targets with the targets of the robot's own controller by a weight.
  While TCI takes the motors, the weight rises from 0, and the targets stay at the measured posture. While TCI
  hands the motors back, the weight falls, and the targets do not change.
- Over rt/lowcmd, no other controller takes the motors back. At the beginning the stiffness rises, and at the
  end the motors are damped for a short time.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.wires.unitree.motors import MOTORS, TARGET

TAKE = 1.0
"""Time [s] in which weight or stiffness rises to the full value. Assumed: the shortest time in the vendor's
examples is safe."""
GIVE = 2.0
"""Time [s] in which the weight (0..1) of TCI's targets over rt/arm_sdk falls to zero. Assumed: in this time,
arms of 4 kg sink without swinging."""
DAMPED = 0.2
"""Time [s] for which the motors are damped at the end of control over rt/lowcmd. Assumed: joints come to rest
in this time."""
DAMPING = 2.0
"""Gain [N m s/rad] of the damping at the end of control over rt/lowcmd. Assumed: twice the gain in the
vendor's examples for arms is sufficient."""
QUIET = 0.1
"""Time [s] without new targets after which TCI sends zero velocities and torques. Assumed: equal to the
largest age of a usable state."""
LONGEST = 0.02
"""Largest time [s] by which one step advances the handover. Without this bound, the weight would jump after a
pause of the process. Assumed: five periods are enough for normal delays."""
MOVED_AWAY = 0.1
"""A motor has moved away from its target if its distance from the target has grown by more than this [rad]
during a gap in the states. Assumed: the robot's own controller moves a motor by this angle in 0.2 s, if that
controller's posture is 1 rad away."""


class Phase(IntEnum):
    """Phase of the handover. The phase shows if the robot's own controller or TCI moves the motors."""

    WAITING = 0
    """The robot's own controller moves the motors. TCI sends nothing."""
    TAKING = 1
    """TCI takes the motors. Over rt/arm_sdk, the weight of TCI's targets rises; over rt/lowcmd, the motors'
    stiffness. The targets stay at the posture that the robot had at the beginning of this phase."""
    LEADING = 2
    """TCI moves the motors, which follow TCI's targets."""
    GIVING = 3
    """TCI hands the motors back. Over rt/arm_sdk, the weight of TCI's targets falls to 0, and the targets do
    not change. Over rt/lowcmd, the motors are damped."""


def holding(posture: Array, gains: NDArray[np.void], holds: Array | float = 0.0) -> NDArray[np.void]:
    """`TARGET`s (29,) with which the motors hold `posture` (29,) [rad]. Its weight needs the torques `holds`
    (29,) [N m]."""
    targets = np.zeros(MOTORS, TARGET)
    targets["q"], targets["kp"], targets["kd"], targets["holds"] = posture, gains["kp"], gains["kd"], holds
    return targets


class Handover:
    """Weight and targets of the motors during the handover. The caller passes the present time to each
    method."""

    def __init__(self, gains: NDArray[np.void], *, whole: bool) -> None:
        """Stores the motors' `GAINS` (29,). `whole` is True for control over rt/lowcmd."""
        self.phase = Phase.WAITING
        self.weight = 0.0
        """For control over rt/arm_sdk: weight (0..1) of TCI's targets. For control over rt/lowcmd: fraction
        (0..1) of the full stiffness."""
        self._gains, self._whole = gains, whole
        self._goal = np.zeros(MOTORS, TARGET)
        self._now = self._told = 0.0
        self._pushed = np.zeros(MOTORS, dtype=bool)

    def take(self, posture: Array, now: float, holds: Array | float = 0.0) -> None:
        """Begins to take the motors at `posture` (29,) [rad], whose weight needs the torques `holds` (29,)
        [N m], at the time `now` [s]. Has no effect if TCI controls the motors already.
        """
        if self.phase is Phase.WAITING:
            self.phase, self.weight = Phase.TAKING, 0.0
            self._goal = holding(posture, self._gains, holds)
            self._pushed[:] = False
            self._now = self._told = now

    def resume(self, goal: NDArray[np.void], weight: float, now: float) -> None:
        """Begins to hand back motors that another process controlled. `goal` (29,) has the last `TARGET`s of
        that process, and `weight` is its last `Handover.weight`.
        """
        self.phase, self.weight = Phase.LEADING, weight
        self._goal[:] = goal
        self._now = self._told = now
        self.give()

    def follow(
        self, chosen: NDArray[np.bool_], targets: NDArray[np.void], posture: Array, now: float
    ) -> None:
        """Stores a new `TARGET` (29,) for each of the `chosen` motors (29,). The targets of other motors do
        not change, except for the torques that hold them. If a motor followed a torque and is no longer
        chosen, the motor's new target is the motor's angle in `posture` (29,) [rad].
        """
        if self.phase is not Phase.LEADING:
            return
        left = self._pushed & ~chosen
        self._goal[left] = holding(posture, self._gains)[left]
        self._goal["holds"] = targets["holds"]
        self._goal["dq"][~chosen] = self._goal["tau"][~chosen] = 0.0
        self._goal[chosen] = targets[chosen]
        self._pushed = chosen & (targets["kp"] == 0.0)
        self._told = now

    def give(self) -> None:
        """Begins to hand the motors back. Over rt/arm_sdk, the weight of TCI's targets falls from its present
        value to 0, and the targets do not change. Over rt/lowcmd, the motors are damped for a short time.
        """
        if self.phase in (Phase.TAKING, Phase.LEADING):
            self.phase = Phase.GIVING
            if self._whole:
                self.weight = 1.0  # over rt/lowcmd, the weight only measures the time of damping

    def give_unseen(self, before: Array, posture: Array) -> None:
        """Begins to hand back the motors of a robot whose posture changed from `before` to `posture` (29,)
        [rad] while no states arrived.

        If a motor is now farther from its target than before the gap, by more than 0.1 rad, its present angle
        becomes its new target: the old target would cause a step. Other targets do not change, since a loaded
        motor is always at a small distance from its target.
        """
        self.give()
        goal = self._goal["q"]
        away = np.abs(posture - goal) > np.abs(before - goal) + MOVED_AWAY
        goal[away] = posture[away]

    def step(self, now: float) -> NDArray[np.void]:
        """Advances the handover to the time `now` [s]. Returns what to send, rows (29,) of `TARGET`."""
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
            sent["dq"] = sent["tau"] = 0.0
            sent["kd"] = np.maximum(sent["kd"], self._gains["kd"])
        if self._whole and self.phase is Phase.TAKING:
            sent["kp"] *= self.weight
            sent["holds"] *= self.weight
        elif self._whole and self.phase is not Phase.LEADING:
            sent["kp"], sent["kd"], sent["holds"] = 0.0, DAMPING, 0.0
        sent["tau"] += sent["holds"]
        return sent
