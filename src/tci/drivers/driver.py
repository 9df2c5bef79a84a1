"""The base class of all drivers."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Self
from weakref import finalize

import numpy as np

from tci.drivers.commander import Baton
from tci.drivers.diagnosis import Finding
from tci.drivers.info import DriverInfo
from tci.drivers.lease import Lease, has_locks, held, lease
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.gate import Gate, SafeCommand
from tci.messages import JointReading, Mode, ModeLike, PlatformCommand, Reading
from tci.messages.clock import Clock, ticks
from tci.robot.description import Robot, Servo

Write = Callable[[SafeCommand], SafeCommand]


class Driver(ABC):
    """A connection to one robot. `read` returns sensor data, and `write` sends the commands that the driver's
    gate created. A subclass implements `_receive`, `_send` and `_close`, which communicate with the robot.
    These methods also convert between the robot's units and SI units, and between the robot's joint order and
    the description's joint order. `read` does not require an armed driver. `write` requires an armed driver
    and a command that `gate` created."""

    def __init__(self, info: DriverInfo) -> None:
        """Stores `info`, the facts about the connection. The constructor of every subclass must call this
        constructor first. Most subclasses create `info` with `DriverInfo.of`."""
        self.info = info
        """Facts about the connection. Only the constructor of a driver may replace them."""
        self._open = True
        self._baton = Baton(info.robot.name)
        self._lease: Lease | None = None
        self._check_lease: Callable[[], None] | None = None

    def __repr__(self) -> str:
        reached = self.info.lease_name.partition(":")[0] if self.info.harmless else self.info.lease_name
        may = ("armed" if self.armed else "read-only") if self._open else "closed"
        return f"{type(self).__name__}({self.robot.name!r} by {reached}, {may}, {1.0 / self.period:.4g} Hz)"

    @property
    def robot(self) -> Robot:
        """Description of the robot."""
        return self.info.robot

    @property
    def clock(self) -> Clock:
        """Clock of all time stamps."""
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
        """Returns the latest reading of joints and skin. Joint data is in SI units and in the description's
        joint order."""

    @abstractmethod
    def _send(self, safe: SafeCommand) -> None:
        """Sends a command to the robot."""

    @abstractmethod
    def _close(self) -> None:
        """Closes the connection and releases all resources."""

    @classmethod
    def load_library(cls) -> None:
        """Imports the optional libraries that this driver needs. The driver's module does not import these
        libraries, since they are missing in some installations. Raises MissingExtraError if a library is not
        installed.
        """
        return

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        """Tries each step of connecting to `address`, to find out which step fails and why. Creates no
        driver, and moves no joint. A failed step gives a finding with advice, not an exception."""
        return ()

    def diagnose(self) -> tuple[Finding, ...]:
        """Returns findings that are specific to this kind of driver. Moves no joint.

        Examples of findings are the protocol version in use, lost frames, the offset of the robot's clock,
        and joint limits that are stored in the robot and differ from those in the description.

        Raises DriverError if the robot does not answer.
        """
        return ()

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        """Yields the present time [s] once per `period`, for a control loop. Starts at the time `start` [s],
        by default now. Ends after `duration` [s], by default never.
        """
        return ticks(self.clock, self.period, duration=duration, start=start)

    def read(self) -> Reading:
        """Returns the latest joint data and skin frames. Raises DriverError if the driver is closed."""
        self._check_open()
        return self._receive()

    def write(self, safe: SafeCommand) -> SafeCommand:
        """Sends `safe`, which must be the latest command of this driver's gate. Returns `safe`.

        The first call acquires the lease on a real robot, and `close` releases it. Raises DriverError in
        these cases: the driver is closed or not armed; the command is not the latest command of the gate, or
        has already been sent; another process, or another part of this program, commands the robot.
        """
        self._check_open()
        if not self.armed:
            raise DriverError(
                f"the connection to {self.robot.name} is read-only; connect with arm=True (--arm) to move it"
            )
        self._may_write()
        self._baton.check()
        self.gate.check_out(safe)
        self._send(safe)
        return safe

    @contextmanager
    def commanding(self, who: str = "another part of this program") -> Iterator[Write]:
        """The right to command the robot, inside the `with` block: takes the lease, and yields the only
        `write` that still works. `driver.write`, a second `run` or another `commanding` are refused
        meanwhile, in every thread, with an error that names `who`.

        A lease that an earlier `write` acquired is kept. Each write checks the lease. On a system without
        file locks, simulations and recordings need no lease. Raises DriverError if somebody else commands the
        robot, or if the lease's file can't be locked.
        """
        with self._baton.taken(who), self._leased():
            yield lambda safe: self._baton.passed(self.write, safe)

    @contextmanager
    def _leased(self) -> Iterator[None]:
        if self.info.harmless and not has_locks():
            yield
            return
        if (kept := self._kept_lease()) is not None:
            kept.check()
            yield
            return
        with lease(self.info.lease_name) as taken:
            own = self.info.lease_name.startswith(f"sim:{self.robot.name}:{os.getpid()}:")
            self._check_lease = taken.check_inside if own else taken.check
            try:
                yield
            finally:
                self._check_lease = None

    def _may_write(self) -> None:
        """Checks that this process may command the robot. The first call acquires the lease on a real robot,
        unless another driver in this process has it. Raises DriverError if another process commands the
        robot, or if the lease's file can't be used."""
        if self._check_lease is not None:
            self._check_lease()
        elif not self.info.harmless:
            if (other := held(self.info.lease_name)) is not None:
                other.check()
                return
            self._lease = Lease(self.info.lease_name)
            self._check_lease = self._lease.check
            finalize(self, self._lease.close)  # a notebook may drop a driver without closing it

    def _kept_lease(self) -> Lease | None:
        """Returns the lease that `write` acquired."""
        return self._lease

    def _release(self) -> None:
        if self._lease is not None:
            self._lease.close()
            self._lease = self._check_lease = None

    def halt(self) -> None:
        """Stops all joints at the present angles. Calls the robot's own stop function instead of sending a
        command of the gate. After this call, TCI commands no joint until the next `write`. Raises DriverError
        if the driver is closed or not armed.
        """
        self._check_open()
        if not self.armed:
            raise DriverError(
                f"the connection to {self.robot.name} is read-only; connect with arm=True to stop it"
            )
        self._halt()
        self.gate.drop()

    def _halt(self) -> None:
        """Calls the robot's own stop function. The default implementation has no effect, so the robot stops
        at the last target."""
        return

    def native(self, robot_part: str) -> NativePart:
        """Returns the robot's own joints of `robot_part`. A program can command these joints in addition to
        the generic joints. The gate of this driver checks the commands. Raises UnknownNameError if the robot
        lacks `robot_part`.
        """
        return NativePart(robot_part, self.robot.servos_of(robot_part))

    def close(self) -> None:
        """Closes the connection. A second call has no effect."""
        if self._open:
            self._open = False
            try:
                self._close()
            finally:
                self._release()

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
    """Joints of one robot part, with the robot's own joint names. A program needs these names for joints that
    are not generic, such as wrists, fingers and toes (section 3 of the paper)."""

    def __init__(self, name: str, servos: tuple[Servo, ...]) -> None:
        self.name = name
        self.servos = servos
        self._by_name = {servo.name: servo for servo in servos}

    def positions(self, joints: JointReading) -> dict[str, float]:
        """Returns the angle [rad] of each servo. The keys are the robot's own names of the servos."""
        return {servo.name: float(joints.position[servo.index]) for servo in self.servos}

    def command(
        self, values: Mapping[str, float], *, mode: ModeLike = Mode.POSITION, speed: float = np.inf
    ) -> PlatformCommand:
        """Returns a command for the gate. `values` maps the robot's own joint names to the commanded values
        ([rad] in position mode).

        `speed` [rad/s] is an upper bound of the speed, in addition to the servos' limits. By default, only
        the servos' limits apply. Raises CommandError if `values` is empty, and UnknownNameError if the part
        lacks a joint.
        """
        if not values:
            raise CommandError(f"no values for {self.name}; valid names: {', '.join(self._by_name)}")
        for name in values:
            if name not in self._by_name:
                raise UnknownNameError(f"joint of {self.name}", name, self._by_name)
        servos = np.array([self._by_name[name].index for name in values], dtype=np.intp)
        return PlatformCommand(
            mode=Mode.of(mode),
            servos=servos,
            values=np.array([float(value) for value in values.values()]),
            speed=np.full(len(servos), float(speed)),
        )
