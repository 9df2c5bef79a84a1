"""Server of a robot in ROS: topics of ros2_control for any ROS node, and topics of `tci.drivers.remote` for
other TCI processes.

docs/ros.md lists the topics of the server. `Names` defines the names of the topics.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.remote.controllers import Once, PartControllers, values_order
from tci.drivers.remote.encoding import frame_bytes, state_bytes, to_orders, to_state
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.server import RemoteServer
from tci.errors import FrameError
from tci.exports.facts import query
from tci.exports.urdf import to_urdf
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading, SkinFrame
from tci.messages.clock import Every
from tci.reasons import Reason
from tci.recording.schemas import CLOUD, JOINTS, SKIN, joints_values, skin_values
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.robot.wire_units import WireUnits
from tci.shared.ros_node import RosNode
from tci.skin.surfaces import build_surface
from tci.wires.ros.cloud import PatchCloud
from tci.wires.ros.messages import BYTES, NO_LAYOUT, TEXT, TRAJECTORY, VALUES
from tci.wires.ros.names import Names
from tci.wires.ros.trajectory import Trajectory

MOST_ORDERS = 64
"""Largest number of messages with orders that are kept between two periods. Assumed: a few commanders each
send one message per period."""


class RosServer(RemoteServer):
    """Serves a robot through a node of any kind of ROS. Closing the server also closes the node."""

    def __init__(
        self, driver: Driver, address: str, node: RosNode, *, middleware: str, namespace: str
    ) -> None:
        """Offers the topics. Raises UnknownNameError if the robot has no binding to `middleware`."""
        self._node = node
        try:
            super().__init__(driver, address, middleware=middleware)
            self._middleware = middleware
            robot = driver.robot
            names = self._names = Names(robot, middleware, namespace)
            self._position = initial_position(robot)
            period = 1.0 / robot.binding(middleware).rate
            self._states, self._is_due = Every(period), False
            self._units = WireUnits(robot)
            self._joint_names = [names.joint(servo) for servo in robot.servos]
            self._state = node.advertise(names.state, BYTES)
            self._joints = node.advertise(names.joints, JOINTS)
            self._refusals = node.advertise(names.topic("tci/refusals"), TEXT)
            self._arrived: deque[bytes] = deque(maxlen=MOST_ORDERS)
            node.subscribe(names.orders, BYTES, self._receive_orders, keep=MOST_ORDERS)
            kinematics = KinematicChain(robot)
            self._skin = {
                patch.name: PatchTopics(robot, number, node, names, kinematics, period)
                for number, patch in enumerate(robot.skin)
            }
            node.subscribe(names.state, BYTES, self._hear_state, keep=MOST_ORDERS)
            self._controllers = PartControllers(robot, self.number, of="a ROS node")
            for part in names.parts():
                node.subscribe(names.trajectory(part), TRAJECTORY, partial(self._execute_trajectory, part))
                node.subscribe(names.values(part), VALUES, partial(self._execute_values, part))
            node.advertise(names.topic("tci/facts"), TEXT, latched=True)((query(robot).model_dump_json(),))
            if robot.model is not None:
                node.advertise(names.topic("robot_description"), TEXT, latched=True)((to_urdf(robot),))
        except BaseException:
            node.close()
            raise

    def where(self) -> str:
        return f"{self._names.joints} and the topics beside it"

    def reach(self) -> str:
        return f"{self._middleware}:{self.address}"

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self._position = reading.joints.position
        self._is_due = self._states.due(self.driver.clock.now())
        if self._is_due:
            told = self._units.told(reading.joints)
            self._joints(joints_values(self._joint_names, told, self._epoch(told.stamp)))
        super().publish(reading, perception, sent)
        for reason in (*sent.refusals, *self._controllers.refusals(self.commanders.states())):
            self._refusals((reason.text,))

    def refuse(self, order: Order, reason: Reason) -> None:
        super().refuse(order, reason)
        self._refusals((reason.text,))

    def close(self) -> None:
        self._node.close()

    def _poll(self) -> Iterator[Orders]:
        self._node.poll()
        yield from self._controllers.messages(self._position, self.driver.clock.now())
        while self._arrived:
            try:
                yield to_orders(self.driver.robot, self._arrived.popleft())
            except FrameError as error:
                self._refusals((str(error),))

    def _show(self, state: State) -> None:
        if self._is_due:
            self._state((NO_LAYOUT, np.frombuffer(state_bytes(self.driver.robot, state), dtype=np.uint8)))

    def _show_skin(self, frame: SkinFrame) -> None:
        topics = self._skin[frame.patch]
        if topics.every.due(frame.stamp):
            topics.publish(SessionFrame(self.number, frame), self._epoch(frame.stamp))

    def _hear_state(self, fields: Mapping[str, Any]) -> None:
        self._overhear(lambda: to_state(self.driver.robot, bytes(fields["data"])))

    def _receive_orders(self, fields: Mapping[str, Any]) -> None:
        self._arrived.append(bytes(fields["data"]))

    def _execute_trajectory(self, part: str, fields: Mapping[str, Any]) -> None:
        joints = {self._names.joint(servo): servo.index for servo in self.driver.robot.servos_of(part)}
        self._controllers.start(part, partial(Trajectory, part, joints, fields, self._units))

    def _execute_values(self, part: str, fields: Mapping[str, Any]) -> None:
        servos = self.driver.robot.servos_of(part)
        self._controllers.start(
            part, lambda *_: Once(values_order(part, servos, fields["data"], self._units))
        )

    def _epoch(self, stamp: float) -> float:
        """Converts a time [s] on the driver's clock to ROS time, the seconds since 1970."""
        return time.time() + stamp - self.driver.clock.now()


class PatchTopics:
    """The topics on which the skin frames of one patch are published."""

    def __init__(
        self,
        robot: Robot,
        number: int,
        node: RosNode,
        names: Names,
        kinematics: KinematicChain,
        period: float,
    ) -> None:
        patch = robot.skin[number]
        self._robot, self._number = robot, number
        self.every = Every(period)
        """Limits the frames per second to the rate that the robot's binding gives."""
        self._cloud = PatchCloud(patch, build_surface(robot, patch, kinematics))
        self._points = node.advertise(names.points(patch.name), CLOUD)
        self._frames = node.advertise(names.frames(patch.name), BYTES)
        self._raw = node.advertise(names.skin(patch.name), SKIN) if node.supports(SKIN) else None

    def publish(self, message: SessionFrame, stamp: float) -> None:
        """Publishes a skin frame that was measured at `stamp` [s], seconds since 1970."""
        frame = message.frame
        self._frames((NO_LAYOUT, np.frombuffer(frame_bytes(self._robot, message), dtype=np.uint8)))
        self._points(self._cloud.values(frame, stamp))
        if self._raw is not None:
            self._raw(skin_values(frame, self._number, stamp))
