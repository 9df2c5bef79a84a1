"""Topics and joint names of a robot in ROS."""

from __future__ import annotations

from tci.errors import DriverError
from tci.robot.description import Robot, Servo, wire_name
from tci.robot.wire_units import wire_joint


def token(name: str) -> str:
    """Returns a name from a robot's description in a form that is valid in the name of a ROS topic or
    node."""
    return wire_name(name, dash=False)


class Names:
    """The names of a robot's topics and joints in ROS.

    The name of a joint or topic is its address in the robot's binding. If the binding has no address for the
    joint or topic, the name follows the conventions of ROS.
    """

    def __init__(self, robot: Robot, middleware: str, namespace: str) -> None:
        """Reads the names from the robot's binding to `middleware`. `namespace` begins with `/`, or is empty.

        Raises DriverError if two servos, two parts or two patches would have equal names in ROS.
        """
        self._robot = robot
        self._binding = robot.binding(middleware)
        self._namespace = namespace
        self.indices: dict[str, int] = {}
        """Index of each servo by the servo's joint name in ROS."""
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
        """Topic of sensor_msgs/JointState, with the name that ros2_control's joint_state_broadcaster uses."""
        return self.topic("joint_states")

    @property
    def imu(self) -> str | None:
        """Topic of sensor_msgs/Imu: the address of `imu` in the robot's binding.

        If the binding lacks this address, the topic depends on the robot. A robot whose touches are detected
        by joint torques has the topic `imu/data` (REP 145). Other robots need no accelerations, and the value
        is None.
        """
        feels = any(patch.through_joints for patch in self._robot.patches)
        name = self._binding.address("imu", "imu/data" if feels else "")
        return self.topic(name) if name else None

    @property
    def state(self) -> str:
        """Topic on which other TCI processes (`tci.drivers.remote`) receive the robot's states, as
        std_msgs/UInt8MultiArray. It has the robot's name, so a served robot hides no other one."""
        return self.topic(f"tci/{token(self._robot.name)}/state")

    @property
    def orders(self) -> str:
        """Topic on which other TCI processes (`tci.drivers.remote`) send orders, as
        std_msgs/UInt8MultiArray."""
        return self.topic(f"tci/{token(self._robot.name)}/orders")

    def frames(self, patch: str) -> str:
        """Returns the topic on which other TCI processes (`tci.drivers.remote`) receive a patch's skin
        frames, as std_msgs/UInt8MultiArray."""
        return self.topic(f"tci/{token(self._robot.name)}/frames/{token(patch)}")

    def topic(self, name: str) -> str:
        """Returns the name of a topic in the robot's namespace. A name that begins with a slash stays
        unchanged."""
        return name if name.startswith("/") else f"{self._namespace}/{name}"

    def joint(self, servo: Servo) -> str:
        """Returns the name of a joint, as in the kinematic model and in `robot_description`."""
        return self._binding.address(servo.name, wire_joint(servo) or servo.name)

    def trajectory(self, robot_part: str) -> str:
        """Returns the topic of trajectory_msgs/JointTrajectory for ros2_control's
        joint_trajectory_controller."""
        return self.topic(f"{token(robot_part)}_controller/joint_trajectory")

    def values(self, robot_part: str) -> str:
        """Returns the topic of std_msgs/Float64MultiArray for ros2_control's forward_command_controller."""
        return self.topic(f"{token(robot_part)}_controller/commands")

    def command(self, robot_part: str) -> str:
        """Returns the topic on which the robot receives commands for a robot part.

        If the topic's name ends in `/commands`, its messages are Float64MultiArray, otherwise
        JointTrajectory.
        """
        return self.topic(self._binding.address(robot_part, self.trajectory(robot_part)))

    def skin(self, patch: str) -> str:
        """Returns the topic of tci_msgs/SkinFrame with the raw frames of a patch."""
        return self.topic(self._binding.address(patch, f"skin/{token(patch)}"))

    def points(self, patch: str) -> str:
        """Returns the topic of sensor_msgs/PointCloud2 with a patch's raw values, positions and pressures."""
        return f"{self.skin(patch)}/points"

    def parts(self) -> tuple[str, ...]:
        """Returns the names of all robot parts. The description names the robot part of each servo."""
        return tuple(dict.fromkeys(servo.robot_part for servo in self._robot.servos))
