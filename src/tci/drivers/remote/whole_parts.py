"""Set-points for controllers that accept only commands to all joints of a robot part."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from tci.errors import DriverError
from tci.gate.safe_command import GateState, SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import Robot


class WholeParts:
    """Turns commands to some joints of a robot part into commands to all joints of the part.

    Joints without a command keep the position that they had when the first joint of their part came under
    command.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._commanded: AbstractSet[int] = frozenset()
        self._stopped = False
        self._stays: dict[int, float] = {}

    def forget(self) -> None:
        """Deletes the stored positions of joints without a command.

        This is needed after the robot was disconnected or halted, since the robot's posture may have changed.
        """
        self._stays.clear()

    def complete(self, safe: SafeCommand, here: Array) -> dict[str, list[float]]:
        """Returns the set-points [rad] for each robot part that has a servo under command.

        Each list has all servos of the part, in the order of `Robot.servos_of`. `here` (n_servos,) [rad] are
        the measured angles of all servos.

        Raises DriverError if a command is not in position mode.
        """
        for servo, mode in zip(safe.servos.tolist(), safe.modes, strict=True):
            if mode is not Mode.POSITION:
                name = self._robot.servos[servo].name
                raise DriverError(f"{name} is in {mode.value} mode; this robot takes: position")
        wanted = dict(zip(safe.servos.tolist(), safe.position.tolist(), strict=True))
        was_stopped, self._stopped = self._stopped, safe.state is GateState.STOP
        if not self._commanded <= wanted.keys() or (was_stopped and not self._stopped):
            # A person may have moved joints that are no longer under command, and other joints of their robot
            # parts.
            self.forget()
        self._commanded = wanted.keys()
        for servo in wanted:
            self._stays.pop(servo, None)
        parts = dict.fromkeys(self._robot.servos[servo].robot_part for servo in wanted)
        return {
            part: [
                wanted[i] if i in wanted else self._stays.setdefault(i, float(here[i]))
                for i in (servo.index for servo in self._robot.servos_of(part))
            ]
            for part in parts
        }
