"""Reads and commands a robot with the topics of ros2_control. TCI receives JointState messages, and sends
JointTrajectory or Float64MultiArray messages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from tci.drivers.remote.whole_parts import WholeParts
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import Reading
from tci.messages.frames import Array
from tci.recording.schemas import CLOUD, IMU, JOINTS, SKIN, raw_of_cloud, to_frame
from tci.robot.description import Robot
from tci.robot.wire_units import WireUnits
from tci.shared.ros_node import Callback, Publish, RosNode
from tci.wires.ros.arrivals import ImuArrivals, JointArrivals, SkinArrivals
from tci.wires.ros.messages import NO_LAYOUT, TRAJECTORY, VALUES
from tci.wires.ros.names import Names

QUEUE = 16
"""Largest number of JointState messages that are kept between two periods. Assumed: a robot has a few
publishers, each of which sends some of the joints."""


class NativeRobot:
    """Reads and commands one robot through the robot's own topics, for a `RosDriver`."""

    def __init__(
        self, robot: Robot, node: RosNode, names: Names, *, arm: bool, period: float, now: Callable[[], float]
    ) -> None:
        """Subscribes to joints, accelerations and skin. With `arm`, also offers the topics of commands. Each
        command asks the robot to reach the commanded positions after one `period` [s]."""
        self.robot = robot
        self._names = names
        self._now = now
        self._nanoseconds = round(period * 1e9)
        self.joints = JointArrivals(robot, names.indices)
        self._imu = ImuArrivals(robot)
        self.skin = {patch.name: SkinArrivals(robot, patch.name) for patch in robot.skin}
        self._parts, self._units = WholeParts(robot), WireUnits(robot)
        self._out: dict[str, Publish] = {}
        node.subscribe(names.joints, JOINTS, self._timed(self.joints.receive), keep=QUEUE)
        if names.imu is not None:
            node.subscribe(names.imu, IMU, self._timed(self._imu.receive))
        for patch in self.skin:
            node.subscribe(names.points(patch), CLOUD, self._timed(partial(self._receive_cloud, patch)))
            if node.supports(SKIN):
                node.subscribe(names.skin(patch), SKIN, self._timed(partial(self._receive_frame, patch)))
        if arm:
            for part in names.parts():
                kind = VALUES if self._plain(part) else TRAJECTORY
                self._out[part] = node.advertise(names.command(part), kind)

    @property
    def complete(self) -> bool:
        """True as soon as data of every joint and every patch has arrived."""
        received = (arrivals.latest is not None for arrivals in self.skin.values())
        return self.joints.latest is not None and all(received)

    def reading(self) -> Reading:
        """Returns the latest data. Raises DriverError until data of every joint has arrived."""
        if self.joints.latest is None:
            raise DriverError(f"no joints of {self.robot.name} yet")
        frames = (arrivals.latest for arrivals in self.skin.values())
        joints = self._imu.complete(self.joints.latest)
        return Reading(joints, tuple(frame for frame in frames if frame is not None))

    def forget(self) -> None:
        """Deletes the stored positions at which joints without a command are held.

        The driver calls this after the robot was disconnected or halted, since the robot's posture may have
        changed.
        """
        self._parts.forget()

    def send(self, safe: SafeCommand) -> None:
        """Sends a command to each robot part that has a servo under command.

        Raises DriverError if a command is not in position mode.
        """
        for part, position in self._parts.complete(safe, self.reading().joints.position).items():
            self._out[part](self._message(part, np.array(position)))

    def _message(self, part: str, angles: Array) -> tuple[Any, ...]:
        servos = self.robot.servos_of(part)
        position = self._units.places(np.array([servo.index for servo in servos], dtype=np.intp), angles)
        if self._plain(part):
            return NO_LAYOUT, position
        duration = self._nanoseconds // 10**9, self._nanoseconds % 10**9
        names = [self._names.joint(servo) for servo in servos]
        return 0, 0, "", names, [(position, (), (), (), duration)]

    def _plain(self, part: str) -> bool:
        return self._names.command(part).endswith("/commands")

    def _timed(self, use: Callable[[Mapping[str, Any], float], None]) -> Callback:
        return lambda fields: use(fields, self._now())

    def _receive_cloud(self, patch: str, fields: Mapping[str, Any], arrival: float) -> None:
        self.skin[patch].receive(fields, raw_of_cloud(fields), arrival)

    def _receive_frame(self, patch: str, fields: Mapping[str, Any], arrival: float) -> None:
        frame = to_frame(fields)
        if frame.patch != patch:
            raise DriverError(f"a frame of {frame.patch[:40]!r} on the topic of {patch}")
        self.skin[patch].receive(fields, frame.values, arrival)
