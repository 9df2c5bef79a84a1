"""`ros2[:NAMESPACE]`: robots in ROS 2, through rclpy if ROS 2 is installed, else through cyclonedds.

In ROS 2, every node that discovers a robot can command this robot. Therefore TCI's nodes and other nodes find
each other only on this machine. To reach other machines, set ROS_AUTOMATIC_DISCOVERY_RANGE.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec

from tci.drivers.driver import Driver
from tci.errors import DriverError
from tci.robot.description import Robot
from tci.shared.own_sockets import on_loopback
from tci.wires.ros.driver import WAIT, RosDriver
from tci.wires.ros.names import token
from tci.wires.ros.node import RosNode, namespace_of
from tci.wires.ros.server import RosServer

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
HERE = ("LOCALHOST", "OFF")
"""Discovery ranges that are limited to this machine."""

_Node: Callable[..., RosNode]
if find_spec("rclpy") is not None:
    from tci.wires.ros.ros2_rclpy import RclpyNode

    _Node = RclpyNode
else:
    from tci.wires.ros.ros2_dds import DdsNode

    _Node = DdsNode


def discovery_range() -> str:
    """Returns the range in which nodes discover each other; LOCALHOST if no range is set.

    ROS itself uses SUBNET if no range is set. Raises DriverError for an invalid range.
    """
    found = os.environ.get(RANGE) or RANGES[0]
    if found not in RANGES:
        raise DriverError(f"{RANGE} is {found!r}; valid: {', '.join(RANGES)}")
    return found


def open_node(name: str, namespace: str) -> RosNode:
    """Opens a node of rclpy if rclpy is installed, else a node of cyclonedds.

    Raises DriverError if an environment variable has an invalid value.
    """
    reach = discovery_range()
    with on_loopback() if reach in HERE else nullcontext():
        return _Node(name, namespace, reach=reach)


class Ros2Driver(RosDriver):
    """A driver of a robot in ROS 2."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """Connects to the robot in the namespace `address`.

        Raises DriverError if no joints arrive within `wait` [s].
        """
        namespace = namespace_of(address)
        node = open_node(f"tci_{token(robot.name)}_behaviour", namespace)
        super().__init__(robot, node, middleware="ros2", namespace=namespace, arm=arm, wait=wait)

    def _where_else(self) -> str:
        here = discovery_range() in HERE
        return f"; for robots on other machines set {RANGE}=SUBNET" if here else ""


class Ros2Server(RosServer):
    """Serves a robot to programs in ROS 2."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Serves the robot in the namespace `address`. Raises DriverError if the node can't be opened."""
        namespace = namespace_of(address)
        node = open_node(f"tci_{token(driver.robot.name)}", namespace)
        super().__init__(driver, address, node, middleware="ros2", namespace=namespace)

    def where(self) -> str:
        everybody = "read and commanded by everybody on the network"
        return f"{super().where()}, {'on this machine' if discovery_range() in HERE else everybody}"
