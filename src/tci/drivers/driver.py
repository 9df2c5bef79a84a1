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

    A subclass communicates with the robot in `_receive`, `_send` and `_close`. In these methods it converts
    the robot's units to SI units and the robot's joint order to the description's order, and back. Reading is
    always allowed. Writing needs an armed driver and a command that `gate` created.
    """

    before_write: Callable[[], None] | None = None
    """Function that `write` calls before it sends a command. It raises DriverError if this process may no
    longer command the robot."""

    def __init__(self, info: DriverInfo) -> None:
        """Stores `info`, the facts about the connection. Every subclass must call this constructor first.
        Most subclasses create `info` with `DriverInfo.of`."""
        self.info = info
        """Facts about the connection. A driver may replace them while it connects, but not later."""
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
        """Safety gate of this driver. `write` accepts only commands that this gate created."""
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
        """Returns the latest reading of joints and skin. Joints are in SI units and in the description's
        order."""

    @abstractmethod
    def _send(self, safe: SafeCommand) -> None:
        """Sends a command to the robot."""

    @abstractmethod
    def _close(self) -> None:
        """Closes the connection and every resource."""

    @classmethod
    def load_library(cls) -> None:
        """Loads optional libraries. The driver's module does not import them, since some installations lack
        them.

        Raises MissingExtraError if a library is not installed.
        """
        return

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        """Checks each step of a connection to `address`, to find out why a connection fails. Creates no
        driver, and moves nothing.

        If a step fails, the result contains a finding with advice; no exception is raised.
        """
        return ()

    def diagnose(self) -> tuple[Finding, ...]:
        """Returns findings that only this kind of driver can provide. Moves nothing.

        Examples are the protocol version in use, lost frames, the offset of the robot's clock, and
        differences between the robot's own limits and its description.

        Raises DriverError if the robot does not answer.
        """
        return ()

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        """Yields the present time [s] once per `period`, for a loop.

        Begins at `start` [s], by default now. Ends after `duration` [s]; by default it never ends.
        """
        return ticks(self.clock, self.period, duration=duration, start=start)

    def read(self) -> Reading:
        """Returns the latest joint data and skin frames. Raises DriverError if the driver is closed."""
        self._check_open()
        return self._receive()

    def write(self, safe: SafeCommand) -> SafeCommand:
        """Sends the latest command of this driver's gate, and returns the command that was sent.

        Raises DriverError in these cases: the driver is closed or not armed; the command is not the latest
        command of the gate, or was sent before; another process commands the robot.
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
        """Stops all joints at their present angles. This calls the robot's own stop function instead of
        sending a command of the gate.

        After this call TCI commands no joint until the next `write`. Raises DriverError if the driver is
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
        """Calls the robot's own stop function. The default does nothing: the robot stops at its last
        target."""
        return

    def native(self, robot_part: str) -> NativePart:
        """Returns the robot's own joints of `robot_part`.

        A program can command these joints in addition to the generic joints, through the gate of this driver.
        Raises UnknownNameError if the robot lacks `robot_part`.
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
    """Joints of one robot part, under the robot's own names. Needed for joints that are not generic, such as
    wrists, fingers and toes (§3)."""

    def __init__(self, name: str, servos: tuple[Servo, ...]) -> None:
        self.name = name
        self.servos = servos
        self._by_name = {servo.name: servo for servo in servos}

    def positions(self, joints: JointReading) -> dict[str, float]:
        """Returns the angle [rad] of each servo, by the robot's own name of the servo."""
        return {servo.name: float(joints.position[servo.index]) for servo in self.servos}

    def command(
        self, values: Mapping[str, float], *, mode: Mode = Mode.POSITION, speed: float = np.inf
    ) -> PlatformCommand:
        """Returns a command for the gate, from `values` by the robot's own joint names ([rad] in position
        mode).

        `speed` [rad/s] is an upper bound of the speed, in addition to the servos' limits. Raises CommandError
        if `values` is empty, and UnknownNameError if the part lacks a joint.
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
