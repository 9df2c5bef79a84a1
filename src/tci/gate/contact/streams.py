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
PAUSE = 0.1
"""Time [s] between orders from which on they are no stream: a behaviour that asks again."""
LONG = 0.3
"""Time [s] for which a stream was refused."""


class Stream:
    """Orders for the angles of one group that a contact refused."""

    def __init__(self, servos: NDArray[np.intp]) -> None:
        self._servos = servos
        self.forget()

    def forget(self) -> None:
        self._since = self._last = -np.inf

    def refuses(
        self, robot: Robot, order: PlatformOrder, position: Array, now: float, *, blocked: bool
    ) -> bool:
        """Whether an order at `now` [s] must not pass: while the group is `blocked`, and afterwards as long
        as a stream asks for angles that are not near the measured `position` (n_servos,) [rad]. Raises
        CommandError for an invalid order."""
        if not isinstance(order, PlatformCommand) or order.mode not in (Mode.POSITION, Mode.IMPEDANCE):
            return blocked
        goes_on = 0.0 <= now - self._last <= PAUSE
        if not blocked:
            long = goes_on and self._last - self._since >= LONG
            if not long or self._near(check_command(robot, order), position):
                self.forget()
                return False
        elif not goes_on:
            self._since = now
        self._last = now
        return True

    def _near(self, order: PlatformCommand, position: Array) -> bool:
        away = np.abs(order.values - position[order.servos])[np.isin(order.servos, self._servos)]
        return bool(away.max(initial=0.0) <= np.deg2rad(NEAR))
