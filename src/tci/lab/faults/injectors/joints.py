"""Faults of encoders and servos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tci.lab.faults.injectors.injector import Injector
from tci.messages import JointReading, Mode
from tci.messages.frames import Array, read_only


class _Angles(Injector):
    """Base class of faults that change the reported angles."""

    def joints(self, joints: JointReading) -> JointReading:
        age = joints.stamp - self.first.joints.stamp
        return replace(joints, position=read_only(self.angles(joints.position, age)))

    def angles(self, position: Array, age: float) -> Array:
        """Returns the faulty angles (n,) [rad] that replace the measured angles `position` (n,) [rad]. `age`
        [s] is the time since the start of the fault."""
        raise NotImplementedError


class WrongDirection(_Angles):
    """Encoders that report each motion after the start of the fault with the wrong sign."""

    number = 19
    description = "all joints move against their commands (the sign of gamma)"

    def angles(self, position: Array, age: float) -> Array:
        return 2.0 * self.first.joints.position - position


class StaleEncoder(_Angles):
    """Encoders that report constant angles."""

    number = 20
    description = "all angles stay the same to the bit, under fresh stamps and numbers"

    def angles(self, position: Array, age: float) -> Array:
        return self.first.joints.position.copy()


class Stall(Injector):
    """Joints that do not follow commands and report only small random motions."""

    number = 21
    description = "all joints are blocked where they are, and tremble"

    def joints(self, joints: JointReading) -> JointReading:
        age = joints.stamp - self.first.joints.stamp
        angles = self.first.joints.position + 1e-5 * np.sin(300.0 * age)
        speeds = np.full(len(angles), 3e-3 * np.cos(300.0 * age))
        return replace(joints, position=read_only(angles), velocity=read_only(speeds))


class EncoderStep(_Angles):
    """A sudden change of the angle that the first servo reports, although the servo does not move."""

    number = 25
    description = "the first encoder jumps by 10 degrees"

    def angles(self, position: Array, age: float) -> Array:
        stepped = position.copy()
        stepped[0] += np.deg2rad(10.0)
        return stepped


class NaNAngle(_Angles):
    """An encoder that reports not-a-number (NaN) as angle."""

    number = 4
    description = "the angle of the first servo is not a number"

    def angles(self, position: Array, age: float) -> Array:
        spoilt = position.copy()
        spoilt[0] = np.nan
        return spoilt


class ServoOff(Injector):
    """Servos that report loss of power."""

    number = 22
    description = "all servos report that they are off; simulated ones go limp"

    def begin(self) -> None:
        self._world = getattr(self.driver, "world", None)
        self._all = np.arange(len(self.driver.robot.servos))
        if self._world is not None:
            self._world.set_power(self._all, on=False)

    def joints(self, joints: JointReading) -> JointReading:
        return replace(joints, powered=read_only(np.zeros(len(self._all)), np.bool_))

    def end(self) -> None:
        if self._world is not None:
            self._world.set_power(self._all, on=True)


class ModeMismatch(Injector):
    """Servos that report a control mode other than the commanded mode."""

    number = 23
    description = "all servos report torque mode; those in torque mode report position"

    def joints(self, joints: JointReading) -> JointReading:
        loose = (mode is Mode.TORQUE for mode in self.driver.gate.modes)
        return replace(joints, modes=tuple(Mode.POSITION if one else Mode.TORQUE for one in loose))
