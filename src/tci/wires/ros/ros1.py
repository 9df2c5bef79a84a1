"""`ros1[:NAMESPACE]`: robots in ROS 1 (noetic)."""

from __future__ import annotations

from tci.drivers.driver import Driver
from tci.robot.description import Robot
from tci.shared.ros1_node import Ros1Node, is_here, load_rospy
from tci.shared.ros_node import namespace_of
from tci.wires.ros.driver import WAIT, RosDriver
from tci.wires.ros.names import token
from tci.wires.ros.server import RosServer


class Ros1Driver(RosDriver):
    """A driver of a robot in ROS 1."""

    @classmethod
    def load_library(cls) -> None:
        load_rospy()

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """Connects to the robot in the namespace `address`.

        Raises DriverError if no joints arrive within `wait` [s].
        """
        namespace = namespace_of(address)
        node = Ros1Node(f"tci_{token(robot.name)}_behaviour")
        super().__init__(robot, node, middleware="ros1", namespace=namespace, arm=arm, wait=wait)


class Ros1Server(RosServer):
    """Serves a robot to programs in ROS 1."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Serves the robot in the namespace `address`. Raises DriverError if no ROS master answers."""
        namespace = namespace_of(address)
        node = Ros1Node(f"tci_{token(driver.robot.name)}")
        super().__init__(driver, address, node, middleware="ros1", namespace=namespace)

    def where(self) -> str:
        everybody = "read and commanded by everybody on the network"
        return f"{super().where()}, {'on this machine' if is_here() else everybody}"
