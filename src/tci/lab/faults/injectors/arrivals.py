"""Fault injectors for lost, late, duplicated or reordered data."""

from __future__ import annotations

from dataclasses import replace

from tci.errors import DriverError
from tci.lab.faults.injectors.injector import Injector
from tci.messages import JointReading, Reading, SkinFrame


class Dropped(Injector):
    """Loss of all new data."""

    number = 10
    description = "the robot sends nothing new: joints and skin stay as they were, with their old stamps"

    def read(self, reading: Reading) -> Reading:
        return self.first


class SkinSilent(Injector):
    """Loss of all skin data, while new joint data still arrives."""

    number = 10
    description = "the skin sends nothing new, while the joints go on"

    def read(self, reading: Reading) -> Reading:
        return replace(reading, skin=self.first.skin)


class OutOfOrder(Injector):
    """Reordering: every second skin frame is replaced by an old frame."""

    number = 11
    description = "every second skin frame is an old one"

    def begin(self) -> None:
        self._count = 0
        self._old = {frame.patch: frame for frame in self.first.skin}

    def read(self, reading: Reading) -> Reading:
        self._count += 1
        return super().read(reading) if self._count % 2 else reading

    def frame(self, frame: SkinFrame) -> SkinFrame:
        return self._old.get(frame.patch, frame)


class Duplicates(Injector):
    """Duplication: each skin frame arrives twice."""

    number = 12
    description = "every skin frame appears twice in one reading"

    def read(self, reading: Reading) -> Reading:
        return replace(reading, skin=reading.skin + reading.skin)


class Frozen(Injector):
    """Frozen joint data: old angles with new time stamps."""

    number = 14
    description = "the joint data stays the same under fresh stamps"

    def joints(self, joints: JointReading) -> JointReading:
        return replace(self.first.joints, stamp=joints.stamp)


class ConnectionLost(Injector):
    """Loss of the connection."""

    number = 28
    description = "reading from the robot fails"

    def read(self, reading: Reading) -> Reading:
        raise DriverError(f"the connection to {self.driver.robot.name} is lost, on purpose")
