"""Streams of set-points, as teleoperation sends them: what a contact interrupted does not go on, since the
part would strike the same person again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.acceptance import by_servo, check_command
from tci.messages import Mode, PlatformCommand, PlatformOrder
from tci.messages.frames import Array
from tci.robot.description import Robot

NEAR = 5.0
"""Angle [degrees] from the measured posture within which a stream may go on."""
PAUSE = 0.25
"""Time [s] between orders from which on they are no stream: a behaviour that asks again. Policies order ten
times a second, and wireless links pause for as long."""
LONG = 0.3
"""Time [s] for which a stream was refused."""
STILL = float(np.deg2rad(2.0))
"""Speed [rad/s] up to which a stream of velocities lets a joint rest."""
STREAMED = {
    Mode.POSITION: f"one that begins within {NEAR:g} degrees of where it is",
    Mode.IMPEDANCE: f"one that begins within {NEAR:g} degrees of where it is",
    Mode.VELOCITY: "velocities of 0, or back from where they went",
}
"""Modes of streams that are held back, and what is valid in each, beside a pause."""


class Stream:
    """Orders for the angles or velocities of one group that a contact refused."""

    def __init__(self, servos: NDArray[np.intp]) -> None:
        self._servos = frozenset(servos.tolist())
        self.forget()

    def forget(self) -> None:
        self._since = self._last = -np.inf
        self._held = dict[int, float]()  # velocities [rad/s] of servos; 0 after angles: any way is held

    def refuses(
        self, robot: Robot, order: PlatformOrder, position: Array, now: float, *, blocked: bool, handled: bool
    ) -> bool:
        """Whether an order at `now` [s] must not pass: while the group is `blocked`, and afterwards as long
        as a stream asks for angles that are not near the measured `position` (n_servos,) [rad], or for
        velocities the way that the contact interrupted. Each servo goes on once it came near, rested or
        turned back. A capability that `handled` the contact goes on. Raises CommandError for an invalid
        order."""
        if handled or not isinstance(order, PlatformCommand) or order.mode not in STREAMED:
            return blocked
        now = float(now)  # of NumPy's floats, the difference of two infinities warns
        goes_on = 0.0 <= now - self._last <= PAUSE
        if not blocked and (not goes_on or self._last - self._since < LONG):
            self.forget()
            return False
        asked = check_command(robot, order)
        drives = asked.mode is Mode.VELOCITY
        ways = asked.values if drives else asked.values - position[asked.servos]
        most = STILL if drives else np.deg2rad(NEAR)
        goes = {
            servo: way
            for servo, way in by_servo(asked.servos, ways).items()
            if servo in self._servos and abs(way) > most
        }
        if blocked:
            if not goes_on:
                self._since, self._held = now, {}
            for servo, way in goes.items():
                self._held.setdefault(servo, way if drives else 0.0)
        elif not any(way * self._held.get(servo, np.nan) >= 0.0 for servo, way in goes.items()):
            for servo in asked.servos.tolist():
                self._held.pop(servo, None)
            return False
        self._last = now
        return True
