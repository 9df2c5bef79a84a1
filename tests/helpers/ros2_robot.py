"""A robot in genuine ROS 2. The Python of the environment `.peers/ros2` runs this program; this environment
has rclpy and no TCI.

The robot has the topics of ros2_control: those of a joint_state_broadcaster and, for each part, those of a
controller that accepts JointTrajectory and Float64MultiArray. The program prints a line of JSON for each
command. The joints reach commanded angles immediately.

python ros2_robot.py '{"joints": {"LArm": [...]}, "position": {...}, "skin": {"left_forearm": 240}}'
"""

import json
import struct
import sys

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState, PointCloud2, PointField
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

PERIOD = 0.01
about = json.loads(sys.argv[1])
position = dict(about["position"])
rclpy.init()
node = rclpy.create_node("robot", namespace=about.get("namespace", ""))
kind = String if about.get("wrong_type") else JointState
states = node.create_publisher(
    kind, "joint_states", QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
)
skins = {
    patch: node.create_publisher(PointCloud2, f"skin/{patch}/points", QoSProfile(depth=1))
    for patch in about["skin"]
}
imus = node.create_publisher(Imu, "imu/data", QoSProfile(depth=1))
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_publisher(String, "robot_description", latched).publish(String(data="<robot/>"))


def say(**words: object) -> None:
    print(json.dumps(words), flush=True)


def follow(part: str, message: JointTrajectory) -> None:
    point = message.points[-1]
    position.update(zip(message.joint_names, point.positions, strict=True))
    seconds = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
    say(part=part, names=list(message.joint_names), positions=list(point.positions), seconds=seconds)


def take(part: str, message: Float64MultiArray) -> None:
    position.update(zip(about["joints"][part], message.data, strict=True))
    say(part=part, values=list(message.data))


for part in about["joints"]:
    prefix = f"{part}_controller"
    node.create_subscription(JointTrajectory, f"{prefix}/joint_trajectory", lambda m, p=part: follow(p, m), 1)
    node.create_subscription(Float64MultiArray, f"{prefix}/commands", lambda m, p=part: take(p, m), 1)


def tick() -> None:
    stamp = node.get_clock().now().to_msg()
    if about.get("wrong_type"):
        states.publish(String(data="not joints"))
        return
    message = JointState()
    message.header.stamp = stamp
    message.name, message.position = list(position), list(position.values())
    message.effort = [0.01 * place for place in range(len(position))]
    states.publish(message)
    if "imu" in about:
        imu = Imu()
        imu.header.stamp, imu.header.frame_id = stamp, about["imu"]
        imu.linear_acceleration.x, imu.linear_acceleration.z = 1.0, 9.5
        imus.publish(imu)
    for patch, channels in about["skin"].items():
        cloud = PointCloud2(height=1, width=channels, point_step=2, row_step=2 * channels, is_dense=True)
        cloud.header.stamp = stamp
        cloud.fields = [PointField(name="raw", offset=0, datatype=PointField.UINT16, count=1)]
        cloud.data = list(struct.pack(f"<{channels}H", *range(channels)))
        skins[patch].publish(cloud)


for _ in range(about.get("flood", 1)):
    node.create_timer(PERIOD / about.get("flood", 1), tick)
rclpy.spin(node)
