"""`ros2[:NAMESPACE]`: robots in ROS 2, by the machine's own rclpy, or without ROS by cyclonedds."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from tci.middleware.link import Link
from tci.middleware.ros.link import WAIT, RosLink
from tci.middleware.ros.node import RosNode, namespace_of
from tci.middleware.ros.server import RosServer
from tci.model.description import Robot

open_node: Callable[[str, str], RosNode]
"""Opens a node by its name and namespace: of rclpy where that is installed, else of cyclonedds. Raises
LinkError for settings of the environment that can't be."""

if find_spec("rclpy") is not None:
    from tci.middleware.ros2_rclpy import RclpyNode

    open_node = RclpyNode
else:
    from tci.middleware.ros2_dds import DdsNode

    open_node = DdsNode


class Ros2Link(RosLink):
    """A link to a robot in ROS 2."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """`address` is the robot's namespace. Raises LinkError when no joints come within `wait` [s]."""
        namespace = namespace_of(address)
        node = open_node(f"tci_{robot.name}_behaviour", namespace)
        super().__init__(robot, node, middleware="ros2", namespace=namespace, arm=arm, wait=wait)


class Ros2Server(RosServer):
    """Shows a robot in ROS 2."""

    def __init__(self, link: Link, address: str = "") -> None:
        """`address` is the namespace to show it in. Raises LinkError when ROS refuses."""
        namespace = namespace_of(address)
        node = open_node(f"tci_{link.robot.name}", namespace)
        super().__init__(link, address, node, middleware="ros2", namespace=namespace)
