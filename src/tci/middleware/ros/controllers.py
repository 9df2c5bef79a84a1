"""The controllers of a robot that TCI shows: others order in the forms of ros2_control.

Each part counts as one commander beside the TCI processes, so a joint is commanded by one of them at a time.
"""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from tci.errors import CommandError
from tci.frames import Array
from tci.messages import PlatformCommand
from tci.middleware.remote import Commander, Orders
from tci.middleware.ros.names import Names
from tci.middleware.ros.trajectory import Trajectory, movable, values_order
from tci.model.description import Robot

KEEP = 1.0
"""Time [s] after its last order for which a part stays commanded: it comes to rest in it. Ours."""
MOST = 16
"""Messages between two periods that are looked at. Ours."""


class Controllers:
    """All controllers of one robot."""

    def __init__(self, robot: Robot, names: Names, session: int) -> None:
        """`session` is the server's number."""
        self._parts = {part: _Part(robot, part, names, session) for part in names.parts()}
        self._arrived: deque[tuple[str, bool, Mapping[str, Any]]] = deque(maxlen=MOST)
        self._refused: list[str] = []

    def hear(self, part: str, is_trajectory: bool, fields: Mapping[str, Any]) -> None:
        """A JointTrajectory or a Float64MultiArray came for a part."""
        self._arrived.append((part, is_trajectory, fields))

    def messages(self, position: Array, now: float) -> Iterator[Orders]:
        """What they order at `now` [s], with the robot at `position` (n_servos,) [rad]."""
        while self._arrived:
            part, is_trajectory, fields = self._arrived.popleft()
            try:
                self._parts[part].hear(is_trajectory, fields, position, now)
            except CommandError as error:
                self._refused.append(str(error))
        for controller in self._parts.values():
            yield from controller.messages(now)

    def refusals(self, commanders: Iterable[Commander]) -> list[str]:
        """What did not pass since the last call."""
        told, self._refused = self._refused, []
        for commander in commanders:
            for controller in self._parts.values():
                if commander.client == controller.client and commander.refused > controller.refused:
                    controller.refused = commander.refused
                    told.append(commander.reason)
        return told


class _Part:
    """The controller of one part."""

    def __init__(self, robot: Robot, part: str, names: Names, session: int) -> None:
        self.client = secrets.randbits(62) + 1
        self.refused = 0
        self._robot, self._part, self._session = robot, part, session
        self._servos = robot.servos_of(part)
        self._indices = {names.joint(servo): servo.index for servo in self._servos}
        self._trajectory: Trajectory | None = None
        self._values: PlatformCommand | None = None
        self._until: float | None = None
        self._sequence = self._count = 0

    def hear(self, is_trajectory: bool, fields: Mapping[str, Any], position: Array, now: float) -> None:
        if is_trajectory:
            self._trajectory = Trajectory(self._part, self._indices, fields, position, now)
            self._values = None
        else:
            self._values = values_order(self._part, self._servos, fields["data"])
            self._trajectory = None

    def messages(self, now: float) -> Iterator[Orders]:
        order, self._values = self._values, None
        if self._trajectory is not None and (order := self._trajectory.order(now)) is None:
            self._trajectory = None
        if order is not None:
            self._until = now + KEEP
        if self._until is None:
            return
        leaving = now > self._until
        if leaving:
            self._until = None
        self._sequence += 1
        orders = () if order is None else (movable(order, self._robot),)
        self._count += len(orders)
        yield Orders(
            session=self._session, seen=time.monotonic(), client=self.client,
            name=f"a ROS node, to {self._part}_controller", sequence=self._sequence, halt="",
            leaving=leaving, first=self._count, orders=orders,
        )  # fmt: skip
