"""Plans of jerk-limited motions, which the library ruckig computes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from ruckig import (
    ControlInterface,
    InputParameter,
    OutputParameter,
    Result,
    Ruckig,
    RuckigError,
    Synchronization,
)

from tci.messages.frames import Array


class MotionPlanner:
    """Plans the motion of n servos, each towards a target or at a velocity. Computes a new plan only after
    its inputs have changed. Servos with targets arrive at the same time, unless `set_driven` says else."""

    __slots__ = ("_input", "_otg", "_output", "ended")

    def __init__(self, count: int, period: float) -> None:
        """Plans for `count` servos. One step takes `period` [s]. Before the first step, call `set_state`,
        `set_limits`, `set_driven` and, if a servo moves to a target, `set_targets`."""
        self._otg = Ruckig(count, period)
        self._input, self._output = InputParameter(count), OutputParameter(count)
        self.ended = False
        """True if the motion ends with the step that was computed last."""

    def set_state(self, state: Array) -> None:
        """Sets the positions [rad], velocities [rad/s] and accelerations [rad/s2] (3, n) from which the next
        step begins."""
        given = self._input
        given.current_position, given.current_velocity, given.current_acceleration = state.tolist()

    def set_limits(self, acceleration: Array, jerk: Array) -> None:
        """Sets the limits `acceleration` (n,) [rad/s2] and `jerk` (n,) [rad/s3]."""
        self._input.max_acceleration, self._input.max_jerk = acceleration.tolist(), jerk.tolist()

    def set_targets(self, target: Array, speed: Array) -> None:
        """Sets the `target` (n,) [rad] of each servo, and its largest `speed` (n,) [rad/s]."""
        self._input.max_velocity, self._input.target_position = speed.tolist(), target.tolist()

    def set_driven(self, driven: NDArray[np.bool_], *, together: bool = True) -> None:
        """Sets which servos (n,) are driven at a velocity, which is 0 until `set_velocity` is called. The
        other servos move to a target: they arrive at the same time if `together`, else each as soon as it
        can."""
        self._input.target_velocity = [0.0] * len(driven)
        self._input.per_dof_control_interface = [
            ControlInterface.Velocity if one else ControlInterface.Position for one in driven
        ]
        self._input.per_dof_synchronization = [
            Synchronization.Time if together and not one else Synchronization.No for one in driven
        ]

    def set_velocity(self, velocity: Array) -> None:
        """Sets the `velocity` (n,) [rad/s] of servos that are driven. For other servos it must be 0."""
        self._input.target_velocity = velocity.tolist()

    def step(self) -> Array | None:
        """Returns the positions, velocities and accelerations (3, n) after the next step; None if ruckig
        finds no motion. If the robot is to execute this step, the caller must call `take`."""
        plan = self._output
        try:
            self.ended = self._otg.update(self._input, plan) == Result.Finished
            numbers = [*plan.new_position, *plan.new_velocity, *plan.new_acceleration]
        except (RuckigError, ValueError):
            # For a few states ruckig finds no synchronised motion, mostly when a speed limit decreases. If a
            # motion takes longer than ruckig can plan, ruckig returns a number that its Python enumeration
            # lacks. A failed calculation leaves a trajectory in ruckig that must not be continued.
            self._otg.reset()
            return None
        return np.array(numbers).reshape(3, -1)

    def take(self) -> None:
        """Accepts the step that `step` computed last. The next step begins where this step ends."""
        self._output.pass_to_input(self._input)

    def ahead(self, time: float) -> Array:
        """Returns the positions (n,) [rad] that the servos will have after `time` [s], according to the
        present plan."""
        return np.array(self._output.trajectory.at_time(self._output.time + time)[0])
