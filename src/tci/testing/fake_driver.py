"""A robot that does what it is told at once: for tests of capabilities, servers and loops."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.errors import CommandError, DriverError
from tci.gate.safe_command import SafeCommand
from tci.gate.settings import GateSettings
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.clock import Clock, ManualClock
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position
from tci.robot.like import RobotLike, as_robot


class FakeDriver(Driver):
    """A robot without physics: its joints are at the commanded angles in the next reading, and its skin reads
    what a test has set. Nothing waits: its clock advances only when the loop sleeps.

    The gate is the real one. For a robot with physics use `tci.connect(robot, "sim")`; for perceptions
    without a driver, `TouchedRobot`.
    """

    def __init__(
        self,
        robot: RobotLike,
        *,
        clock: Clock | None = None,
        rate: float | None = None,
        arm: bool = True,
        settings: GateSettings | None = None,
    ) -> None:
        """Starts in the initial posture, untouched.

        Args:
            robot: a description, its path, or the name of a robot.
            clock: by default a `ManualClock` that starts at 0.
            rate: readings, skin frames and commands per second; by default as in the simulation.
            arm: False for a robot that refuses to be written to.
            settings: of the gate.
        """
        robot = as_robot(robot)
        period = None if rate is None else 1.0 / rate
        super().__init__(
            DriverInfo.of(
                robot, "sim", clock=clock or ManualClock(), armed=arm, period=period, settings=settings,
                lease_name=f"sim:{robot.name}:{os.getpid()}:{id(self)}",
            )
        )  # fmt: skip
        self.position: Array = np.array(initial_position(robot))
        """Angle (n,) [rad] of each servo; a test may set it, as if somebody had moved the robot."""
        self.skin: dict[str, Array] = {
            patch.name: np.full(patch.channels, float(patch.sensor.rest)) for patch in robot.patches
        }
        """Raw values (channels,) of each patch, at first those of an untouched sensor."""
        self.sent: list[SafeCommand] = []
        """All that was written, the oldest first."""
        self.halts = 0
        """How often `halt` was called."""
        self.fault: str = ""
        """While this is not empty, `read` raises a DriverError with this text."""
        self.frozen = False
        """While True, readings repeat the last joints and skin with their old stamps, as from a robot that
        is cut off."""
        self._count = 0
        self._latest: Reading | None = None

    def set_skin(self, patch: str, values: ArrayLike) -> None:
        """Sets the raw values (channels,) of a patch from the next reading on. Raises UnknownNameError for an
        unknown patch, and CommandError for another number of values."""
        channels, given = self.robot.patch(patch).channels, np.asarray(values, dtype=float)
        if given.shape != (channels,):
            raise CommandError(f"{given.shape} values for {patch}; valid: ({channels},)")
        self.skin[patch] = given

    def joints(self) -> JointReading:
        """The joints now, at rest. A subclass may add torques, or say something wrong."""
        still = read_only(np.zeros(len(self.position)))
        return JointReading(self.clock.now(), self._count, read_only(self.position), still)

    def frames(self, now: float, sequence: int) -> Iterable[SkinFrame]:
        """The skin at the time `now` [s]. A subclass may compute it instead of reading `skin`."""
        return [SkinFrame(name, now, sequence, read_only(raw)) for name, raw in self.skin.items()]

    def _receive(self) -> Reading:
        if self.fault:
            raise DriverError(self.fault)
        if self.frozen and self._latest is not None:
            return self._latest
        self._count += 1
        joints = self.joints()
        self._latest = Reading(joints, tuple(self.frames(joints.stamp, self._count)))
        return self._latest

    def _send(self, safe: SafeCommand) -> None:
        self.sent.append(safe)
        self.position[safe.servos] = safe.position

    def _halt(self) -> None:
        self.halts += 1

    def _close(self) -> None:
        return
