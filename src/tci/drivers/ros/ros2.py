"""`ros2[:NAMESPACE]`: robots in ROS 2, through the machine's own rclpy, or without ROS through cyclonedds.

In ROS 2 every node that discovers a robot may command it. Therefore nodes find each other on this machine
only, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set otherwise.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec

from tci.drivers.driver import Driver
from tci.drivers.own_sockets import on_loopback
from tci.drivers.ros.driver import WAIT, RosDriver
from tci.drivers.ros.names import token
from tci.drivers.ros.node import RosNode, namespace_of
from tci.drivers.ros.server import RosServer
from tci.errors import DriverError
from tci.robot.description import Robot

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
HERE = ("LOCALHOST", "OFF")
"""Ranges that are limited to this machine."""

_Node: Callable[..., RosNode]
if find_spec("rclpy") is not None:
    from tci.drivers.ros.ros2_rclpy import RclpyNode

    _Node = RclpyNode
else:
    from tci.drivers.ros.ros2_dds import DdsNode

    _Node = DdsNode


def discovery_range() -> str:
    """Returns the range of discovery of nodes. ROS itself uses SUBNET if none is set. Raises DriverError."""
    found = os.environ.get(RANGE) or RANGES[0]
    if found not in RANGES:
        raise DriverError(f"{RANGE} is {found!r}; valid: {', '.join(RANGES)}")
    return found


def open_node(name: str, namespace: str) -> RosNode:
    """Opens a node of rclpy if it is installed, else of cyclonedds.

    Raises DriverError for invalid settings of the environment.
    """
    reach = discovery_range()
    with on_loopback() if reach in HERE else nullcontext():
        return _Node(name, namespace, reach=reach)


class Ros2Driver(RosDriver):
    """A driver of a robot in ROS 2."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """Connects; `address` is the robot's namespace. Raises DriverError when no joints arrive within
        `wait` [s]."""
        namespace = namespace_of(address)
        node = open_node(f"tci_{token(robot.name)}_behaviour", namespace)
        super().__init__(robot, node, middleware="ros2", namespace=namespace, arm=arm, wait=wait)

    def _where_else(self) -> str:
        here = discovery_range() in HERE
        return f"; for robots on other machines set {RANGE}=SUBNET" if here else ""


class Ros2Server(RosServer):
    """Serves a robot in ROS 2."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Serves in the namespace `address`. Raises DriverError when ROS refuses."""
        namespace = namespace_of(address)
        node = open_node(f"tci_{token(driver.robot.name)}", namespace)
        super().__init__(driver, address, node, middleware="ros2", namespace=namespace)

    def where(self) -> str:
        everybody = "read and commanded by everybody on the network"
        return f"{super().where()}, {'on this machine' if discovery_range() in HERE else everybody}"
