"""Streams of set-points, as teleoperation sends them: what a contact interrupted does not go on far from the
part, since on its way there the part would strike the same person again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.gate.acceptance import check_command
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


class Stream:
    """Orders for the angles of one group that a contact refused."""

    def __init__(self, servos: NDArray[np.intp]) -> None:
        self._servos = frozenset(servos.tolist())
        self.forget()

    def forget(self) -> None:
        self._since = self._last = -np.inf
        self._far = set[int]()

    def refuses(
        self, robot: Robot, order: PlatformOrder, position: Array, now: float, *, blocked: bool
    ) -> bool:
        """Whether an order at `now` [s] must not pass: while the group is `blocked`, and afterwards as long
        as a stream asks for angles that are not near the measured `position` (n_servos,) [rad]. Each servo
        goes on once it came near. Raises CommandError for an invalid order."""
        if not isinstance(order, PlatformCommand) or order.mode not in (Mode.POSITION, Mode.IMPEDANCE):
            return blocked
        goes_on = 0.0 <= now - self._last <= PAUSE
        if blocked:
            if not goes_on:
                self._since, self._far = now, set()
            self._far |= self._servos.intersection(np.ravel(order.servos).tolist())
            self._last = now
            return True
        if not goes_on or self._last - self._since < LONG:
            self.forget()
            return False
        checked = check_command(robot, order)
        near = np.abs(checked.values - position[checked.servos]) <= np.deg2rad(NEAR)
        if self._far.isdisjoint(checked.servos[~near].tolist()):
            self._far.difference_update(checked.servos.tolist())
            return False
        self._last = now
        return True
