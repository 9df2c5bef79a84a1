"""Types of the standard ROS messages that the ROS drivers use and that recordings do not use."""

from __future__ import annotations

from tci.recording.rosmsg.cdr import MessageType

TEXT = MessageType("std_msgs/msg/String", (("string", "data"),), headed=False)
_LAYOUT = (
    ("std_msgs/MultiArrayLayout", (("std_msgs/MultiArrayDimension[]", "dim"), ("uint32", "data_offset"))),
    ("std_msgs/MultiArrayDimension", (("string", "label"), ("uint32", "size"), ("uint32", "stride"))),
)
VALUES = MessageType(
    "std_msgs/msg/Float64MultiArray",
    (("std_msgs/MultiArrayLayout", "layout"), ("float64[]", "data")),
    needs=_LAYOUT,
    headed=False,
)
BYTES = MessageType(
    "std_msgs/msg/UInt8MultiArray",
    (("std_msgs/MultiArrayLayout", "layout"), ("uint8[]", "data")),
    needs=_LAYOUT,
    headed=False,
)
NO_LAYOUT = ((), 0)
"""Value of the field `layout` of a ROS array message with one dimension."""
TRAJECTORY = MessageType(
    "trajectory_msgs/msg/JointTrajectory",
    (("string[]", "joint_names"), ("trajectory_msgs/JointTrajectoryPoint[]", "points")),
    needs=(
        (
            "trajectory_msgs/JointTrajectoryPoint",
            (
                ("float64[]", "positions"),
                ("float64[]", "velocities"),
                ("float64[]", "accelerations"),
                ("float64[]", "effort"),
                ("builtin_interfaces/Duration", "time_from_start"),
            ),
        ),
        ("builtin_interfaces/Duration", (("int32", "sec"), ("uint32", "nanosec"))),
    ),
)
