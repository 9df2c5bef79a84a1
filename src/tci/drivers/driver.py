"""What every way to a robot has in common."""

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
    """A connection to one robot: `read` what it senses, `write` what its gate made.

    A subclass talks to the robot in `_receive`, `_send` and `_close`; it owns units and order of the
    robot. Reading is always allowed; writing needs an armed driver and a command made by `gate`.
    """

    before_write: Callable[[], None] | None = None
    """Raises DriverError where this process may no longer command the robot; asked before each command."""

    def __init__(self, info: DriverInfo) -> None:
        """Every subclass calls this first; `DriverInfo.of` makes the `info` of most drivers."""
        self.info = info
        """Facts about the connection. Only a driver that learns more while it connects replaces them."""
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
        """The only maker of what `write` takes."""
        return self.info.gate

    @property
    def period(self) -> float:
        """Time from one command to the next [s]."""
        return self.info.gate.period

    @property
    def armed(self) -> bool:
        """Whether it may write."""
        return self.info.armed

    @abstractmethod
    def _receive(self) -> Reading:
        """The latest reading of joints and skin, in SI units and the description's order."""

    @abstractmethod
    def _send(self, safe: SafeCommand) -> None:
        """Put a command on the wire."""

    @abstractmethod
    def _close(self) -> None:
        """Let go of the robot and of every resource."""

    @classmethod
    def load_library(cls) -> None:
        """Loads what its module itself does not: what is there only beside some Pythons.

        Raises MissingExtraError.
        """
        return

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        """What can be reached at `address` without a driver, step by step: for users whose connection fails.

        It moves nothing and raises nothing; each step that fails is a finding with its advice.
        """
        return ()

    def diagnose(self) -> tuple[Finding, ...]:
        """What only this driver knows: the dialect spoken, frames lost, the clock's offset, and where what
        the robot says (names, limits, modes) differs from the description. It moves nothing.

        Raises DriverError when the robot can't be asked.
        """
        return ()

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        """The time now [s], once per `period`, from `start` [s] or now on, for `duration` [s] or for ever."""
        return ticks(self.clock, self.period, duration=duration, start=start)

    def read(self) -> Reading:
        """The latest joints and skin frames. Raises DriverError when the driver is closed."""
        self._check_open()
        return self._receive()

    def write(self, safe: SafeCommand) -> SafeCommand:
        """Send a command of this driver's gate, and return what was sent.

        Raises DriverError when the driver is closed or not armed, when another gate, or nobody's gate, made
        the command, and when somebody else commands the robot.
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
        """The robot's own stop, whatever its commands were taken for: all joints stay where they are now.

        Then nothing is under command, until something is commanded again. Raises DriverError when the driver
        is closed or not armed.
        """
        self._check_open()
        if not self.armed:
            raise DriverError(
                f"the connection to {self.robot.name} is read-only; connect with arm=True to stop it"
            )
        self._halt()
        self.gate.drop()

    def _halt(self) -> None:
        """Stop the robot in its own terms. Without, it stops at the last target that it was sent."""
        return

    def native(self, robot_part: str) -> NativePart:
        """The robot's own joints of `robot_part`, beside the generic ones and through the same gate.

        Raises UnknownNameError.
        """
        return NativePart(robot_part, self.robot.servos_of(robot_part))

    def close(self) -> None:
        """Let go of the robot. A second call does nothing."""
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
    """A part in the robot's own joints, for what is not generic: wrists, fingers, toes (§3)."""

    def __init__(self, name: str, servos: tuple[Servo, ...]) -> None:
        self.name = name
        self.servos = servos
        self._by_name = {servo.name: servo for servo in servos}

    def positions(self, joints: JointReading) -> dict[str, float]:
        """Angle [rad] of each servo by the robot's own name."""
        return {servo.name: float(joints.position[servo.index]) for servo in self.servos}

    def command(
        self, values: Mapping[str, float], *, mode: Mode = Mode.POSITION, speed: float = np.inf
    ) -> PlatformCommand:
        """A command for the gate: `values` by the robot's own joint names, [rad] for positions.

        `speed` [rad/s] is asked for beside the limits. Raises CommandError for no values at all,
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
