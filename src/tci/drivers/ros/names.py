"""Topics and joint names of a robot in ROS."""

from __future__ import annotations

from tci.errors import DriverError
from tci.robot.description import Robot, Servo


class Names:
    """What a robot's topics and joints are called: by custom, or by the addresses of its binding."""

    def __init__(self, robot: Robot, middleware: str, namespace: str) -> None:
        """`namespace` is one of `namespace_of`. Raises DriverError when two servos have one name."""
        self._robot = robot
        self._binding = robot.binding(middleware)
        self._namespace = namespace
        self.indices: dict[str, int] = {}
        """Index of each servo by its name in ROS."""
        for servo in robot.servos:
            if self.indices.setdefault(self.joint(servo), servo.index) != servo.index:
                name = self.joint(servo)
                raise DriverError(f"two servos of {robot.name} are called {name!r}; ROS needs one name each")

    @property
    def joints(self) -> str:
        """sensor_msgs/JointState, as of ros2_control's joint_state_broadcaster."""
        return self.topic("joint_states")

    @property
    def state(self) -> str:
        """std_msgs/UInt8MultiArray: states of `remote`."""
        return self.topic("tci/state")

    @property
    def orders(self) -> str:
        """std_msgs/UInt8MultiArray: orders of `remote`."""
        return self.topic("tci/orders")

    def frames(self, patch: str) -> str:
        """std_msgs/UInt8MultiArray: skin frames of `remote`."""
        return self.topic(f"tci/frames/{patch}")

    def topic(self, name: str) -> str:
        """A topic in the robot's namespace; one that begins with a slash stays as it is."""
        return name if name.startswith("/") else f"{self._namespace}/{name}"

    def joint(self, servo: Servo) -> str:
        """A joint: as in the kinematic model, which `robot_description` shows too."""
        return self._binding.address(servo.name, servo.joint or servo.name)

    def trajectory(self, robot_part: str) -> str:
        """trajectory_msgs/JointTrajectory, as a joint_trajectory_controller takes it."""
        return self.topic(f"{robot_part}_controller/joint_trajectory")

    def values(self, robot_part: str) -> str:
        """std_msgs/Float64MultiArray, as a forward_command_controller takes it."""
        return self.topic(f"{robot_part}_controller/commands")

    def command(self, robot_part: str) -> str:
        """Where a robot takes commands for a part; a name that ends in `/commands` means values."""
        return self.topic(self._binding.address(robot_part, self.trajectory(robot_part)))

    def skin(self, patch: str) -> str:
        """tci_msgs/SkinFrame: raw frames of a patch."""
        return self.topic(self._binding.address(patch, f"skin/{patch}"))

    def points(self, patch: str) -> str:
        """sensor_msgs/PointCloud2: the same with places and pressures."""
        return f"{self.skin(patch)}/points"

    def parts(self) -> tuple[str, ...]:
        """The robot's own parts."""
        return tuple(dict.fromkeys(servo.robot_part for servo in self._robot.servos))
