"""`ros2[:NAMESPACE]`: robots in ROS 2, through rclpy if ROS 2 is installed, else through cyclonedds.

In ROS 2, every node that discovers a robot can command this robot. Therefore TCI's nodes and other nodes find
each other only on this machine. To reach other machines, set ROS_AUTOMATIC_DISCOVERY_RANGE.
"""

from __future__ import annotations

from tci.drivers.driver import Driver
from tci.robot.description import Robot
from tci.shared.ros2_node import HERE, RANGE, discovery_range, open_node
from tci.shared.ros_node import namespace_of
from tci.wires.ros.driver import WAIT, RosDriver
from tci.wires.ros.names import token
from tci.wires.ros.server import RosServer


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
