"""A driver at the end of a wire, for which a test plays the robot's process."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

import tci
from tci.drivers.remote.driver import RemoteDriver
from tci.drivers.remote.protocol import Commander, Orders, SessionFrame, State
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Met, PlatformOrder
from tci.messages.clock import ManualClock
from tci.robot.joint_map import initial_position


class Wire(RemoteDriver):
    """A driver for which the test plays the role of the robot's process."""

    def __init__(self) -> None:
        self.time = ManualClock(100.0)
        super().__init__(tci.load_robot("nao"), middleware="zenoh", place="here", arm=True, clock=self.time)
        self.inbox: list[State | SessionFrame] = []
        self.said: list[Orders] = []
        self.sequence = 0
        self.there = "run"
        """Gate state that the robot's process reports."""
        self.told: tuple[Commander, ...] = ()
        """Commanders that the robot's process reports."""
        self.met: tuple[Met, ...] = ()
        """Contacts that the robot's process reports."""
        self.cut = False

    def tell(self, *, late: float = 0.0) -> None:
        """Delivers a state message that was sent `late` [s] ago."""
        self.sequence += 1
        sent, count = self.time.now() - late, len(self.robot.servos)
        joints = JointReading(sent, self.sequence, np.array(initial_position(self.robot)), np.zeros(count))
        self.inbox.append(State(1, self.sequence, sent, sent, joints, self.there, None, self.told, self.met))

    def age(self, *, late: float = 0.0) -> float:
        """Delivers a state message that was sent `late` [s] ago, and returns the age [s] of the joint data in
        the next reading."""
        self.tell(late=late)
        return self.time.now() - self.read().joints.stamp

    def order(self, *orders: PlatformOrder) -> SafeCommand:
        self.tell()
        return self.write(self.gate.step(orders, self.read().joints, self.time.now()))

    def _poll(self) -> Iterable[State | SessionFrame]:
        came, self.inbox = self.inbox, []
        return came

    def _put(self, orders: Orders) -> None:
        if self.cut:
            raise DriverError("the wire is cut")
        self.said.append(orders)

    def _why_silent(self) -> str:
        return "nobody"
