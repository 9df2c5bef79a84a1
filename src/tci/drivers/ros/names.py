"""Topics and joint names of a robot in ROS."""

from __future__ import annotations

from tci.errors import DriverError
from tci.robot.description import Robot, Servo, wire_name


def token(name: str) -> str:
    """Returns a name of a description as one token of a topic, or as the name of a node."""
    return wire_name(name, dash=False)


class Names:
    """The names of a robot's topics and joints: ROS conventions, or the addresses of its binding."""

    def __init__(self, robot: Robot, middleware: str, namespace: str) -> None:
        """Takes a `namespace` as `namespace_of` returns it.

        Raises DriverError when two servos, parts or patches have one name.
        """
        self._robot = robot
        self._binding = robot.binding(middleware)
        self._namespace = namespace
        self.indices: dict[str, int] = {}
        """Index of each servo by its name in ROS."""
        parts, patches = self.parts(), [patch.name for patch in robot.patches]
        for what, names in (
            ("servos", [self.joint(servo) for servo in robot.servos]),
            ("parts", [self.command(part) for part in parts]),
            ("patches", [self.skin(patch) for patch in patches]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise DriverError(
                        f"two {what} of {robot.name} are called {name!r}; ROS needs one name each: "
                        "give one of them an <address> in a binding"
                    )
        self.indices.update((self.joint(servo), servo.index) for servo in robot.servos)

    @property
    def joints(self) -> str:
        """Topic of sensor_msgs/JointState, as of ros2_control's joint_state_broadcaster."""
        return self.topic("joint_states")

    @property
    def imu(self) -> str | None:
        """Topic of sensor_msgs/Imu: the address of `imu` in the binding, or that of REP 145 for a robot that
        feels through its joints; None for others, which do not need it."""
        feels = any(patch.through_joints for patch in self._robot.patches)
        name = self._binding.address("imu", "imu/data" if feels else "")
        return self.topic(name) if name else None

    @property
    def state(self) -> str:
        """Topic of std_msgs/UInt8MultiArray with the states of `remote`."""
        return self.topic("tci/state")

    @property
    def orders(self) -> str:
        """Topic of std_msgs/UInt8MultiArray with the orders of `remote`."""
        return self.topic("tci/orders")

    def frames(self, patch: str) -> str:
        """Returns the topic of std_msgs/UInt8MultiArray with a patch's skin frames of `remote`."""
        return self.topic(f"tci/frames/{token(patch)}")

    def topic(self, name: str) -> str:
        """Returns a topic in the robot's namespace; a name that begins with a slash stays unchanged."""
        return name if name.startswith("/") else f"{self._namespace}/{name}"

    def joint(self, servo: Servo) -> str:
        """Returns the name of a joint, as in the kinematic model and in `robot_description`."""
        return self._binding.address(servo.name, servo.joint or servo.name)

    def trajectory(self, robot_part: str) -> str:
        """Returns the topic of trajectory_msgs/JointTrajectory, as a joint_trajectory_controller takes it."""
        return self.topic(f"{token(robot_part)}_controller/joint_trajectory")

    def values(self, robot_part: str) -> str:
        """Returns the topic of std_msgs/Float64MultiArray, as a forward_command_controller takes it."""
        return self.topic(f"{token(robot_part)}_controller/commands")

    def command(self, robot_part: str) -> str:
        """Returns the topic on which a robot takes commands for a part; a name that ends in `/commands` means
        values."""
        return self.topic(self._binding.address(robot_part, self.trajectory(robot_part)))

    def skin(self, patch: str) -> str:
        """Returns the topic of tci_msgs/SkinFrame with the raw frames of a patch."""
        return self.topic(self._binding.address(patch, f"skin/{token(patch)}"))

    def points(self, patch: str) -> str:
        """Returns the topic of sensor_msgs/PointCloud2 with a patch's frames, positions and pressures."""
        return f"{self.skin(patch)}/points"

    def parts(self) -> tuple[str, ...]:
        """Returns the robot's own parts."""
        return tuple(dict.fromkeys(servo.robot_part for servo in self._robot.servos))
