"""The base class of all drivers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Self

import numpy as np

from tci.clock import Clock, ticks
from tci.drivers.diagnosis import Finding
from tci.drivers.info import DriverInfo
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.gate import Gate, SafeCommand
from tci.messages import JointReading, Mode, PlatformCommand, Reading
from tci.robot.description import Robot, Servo


class Driver(ABC):
    """A connection to one robot: `read` returns sensor data, `write` sends the commands that the driver's
    gate created.

    A subclass communicates with the robot in `_receive`, `_send` and `_close`, and converts the robot's units
    and order. Reading is always allowed; writing needs an armed driver and a command that `gate` created.
    """

    before_write: Callable[[], None] | None = None
    """Called before each command; raises DriverError when this process may no longer command the robot."""

    def __init__(self, info: DriverInfo) -> None:
        """Stores the facts of the connection. Every subclass calls this first; most create `info` by
        `DriverInfo.of`."""
        self.info = info
        """Facts about the connection. A driver replaces them only if it learns more while it connects."""
        self._open = True

    @property
    def robot(self) -> Robot:
        """Description of the robot."""
        return self.info.robot

    @property
    def clock(self) -> Clock:
        """Clock of all stamps."""
        return self.info.clock

    @property
    def gate(self) -> Gate:
        """The gate; `write` accepts only commands that it created."""
        return self.info.gate

    @property
    def period(self) -> float:
        """Time [s] between two commands."""
        return self.info.gate.period

    @property
    def armed(self) -> bool:
        """True if the driver may write."""
        return self.info.armed

    @abstractmethod
    def _receive(self) -> Reading:
        """Returns the latest reading of joints and skin, in SI units and the description's order."""

    @abstractmethod
    def _send(self, safe: SafeCommand) -> None:
        """Sends a command to the robot."""

    @abstractmethod
    def _close(self) -> None:
        """Closes the connection and every resource."""

    @classmethod
    def load_library(cls) -> None:
        """Loads libraries that the driver's module does not import, because some installations lack them.

        Raises MissingExtraError.
        """
        return

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        """Checks each step of a connection to `address`, without a driver. For users whose connection fails.

        It moves nothing and raises no exception; each step that fails is a finding with advice.
        """
        return ()

    def diagnose(self) -> tuple[Finding, ...]:
        """Returns findings that only this driver can make: the dialect in use, lost frames, the clock's
        offset, and differences between the robot's own data (names, limits, modes) and the description. It
        moves nothing.

        Raises DriverError when the robot does not answer.
        """
        return ()

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        """Yields the present time [s], once per `period`, from `start` [s] or now on, for `duration` [s] or
        for ever."""
        return ticks(self.clock, self.period, duration=duration, start=start)

    def read(self) -> Reading:
        """Returns the latest joints and skin frames. Raises DriverError when the driver is closed."""
        self._check_open()
        return self._receive()

    def write(self, safe: SafeCommand) -> SafeCommand:
        """Sends a command of this driver's gate, and returns what was sent.

        Raises DriverError when the driver is closed or not armed, when the command was not made by this
        driver's gate, and when another process commands the robot.
        """
        self._check_open()
        if not self.armed:
            raise DriverError(
                f"the connection to {self.robot.name} is read-only; connect with arm=True (--arm) to move it"
            )
        if self.before_write is not None:
            self.before_write()
        self.gate.check_out(safe)
        self._send(safe)
        return safe

    def halt(self) -> None:
        """Calls the robot's own stop, which does not use commands of the gate: all joints keep their present
        angles.

        After that no joint is under command until the next command. Raises DriverError if the driver is
        closed or not armed.
        """
        self._check_open()
        if not self.armed:
            raise DriverError(
                f"the connection to {self.robot.name} is read-only; connect with arm=True to stop it"
            )
        self._halt()
        self.gate.drop()

    def _halt(self) -> None:
        """Stops the robot by its own means. The default does nothing: the robot stops at its last target."""
        return

    def native(self, robot_part: str) -> NativePart:
        """Returns the robot's own joints of `robot_part`, to command them in addition to generic joints,
        through the same gate.

        Raises UnknownNameError.
        """
        return NativePart(robot_part, self.robot.servos_of(robot_part))

    def close(self) -> None:
        """Closes the connection. A second call does nothing."""
        if self._open:
            self._open = False
            self._close()

    def _check_open(self) -> None:
        if not self._open:
            raise DriverError(f"the connection to {self.robot.name} is closed")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class NativePart:
    """The robot's own joints of a part, for joints that are not generic: wrists, fingers, toes (§3)."""

    def __init__(self, name: str, servos: tuple[Servo, ...]) -> None:
        self.name = name
        self.servos = servos
        self._by_name = {servo.name: servo for servo in servos}

    def positions(self, joints: JointReading) -> dict[str, float]:
        """Returns the angle [rad] of each servo by the robot's own name."""
        return {servo.name: float(joints.position[servo.index]) for servo in self.servos}

    def command(
        self, values: Mapping[str, float], *, mode: Mode = Mode.POSITION, speed: float = np.inf
    ) -> PlatformCommand:
        """Returns a command for the gate: `values` by the robot's own joint names, [rad] for positions.

        `speed` [rad/s] is an upper bound in addition to the limits. Raises CommandError for no values at all,
        UnknownNameError for a joint that the part lacks.
        """
        if not values:
            raise CommandError(f"no values for {self.name}; valid names: {', '.join(self._by_name)}")
        for name in values:
            if name not in self._by_name:
                raise UnknownNameError(f"joint of {self.name}", name, self._by_name)
        servos = np.array([self._by_name[name].index for name in values], dtype=np.intp)
        return PlatformCommand(
            mode=mode,
            servos=servos,
            values=np.array([float(value) for value in values.values()]),
            speed=np.full(len(servos), float(speed)),
        )
