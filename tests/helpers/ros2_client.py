"""Program for tests that uses genuine ROS 2, without TCI, to read and command a robot that TCI serves.

python ros2_client.py '{"trajectory": {"topic": ..., "names": [...], "points": [[seconds, [rad, ...]]]}}'

The program prints its observations as JSON. `near` says how near to a goal counts.
"""

import json
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

about = json.loads(sys.argv[1])
rclpy.init()
node = rclpy.create_node("client", namespace=about["namespace"])
found: dict[str, object] = {"states": 0, "refusals": []}
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def joints(message: JointState) -> None:
    found["states"] += 1
    found["position"] = dict(zip(message.name, message.position, strict=True))
    found["age"] = time.time() - message.header.stamp.sec - message.header.stamp.nanosec * 1e-9


def cloud(message: PointCloud2) -> None:
    found["cloud"] = [message.width, message.header.frame_id, [field.name for field in message.fields]]


node.create_subscription(JointState, "joint_states", joints, best_effort)
node.create_subscription(PointCloud2, about["cloud"], cloud, best_effort)
node.create_subscription(String, "robot_description", lambda m: found.update(urdf=m.data), latched)
node.create_subscription(String, "tci/facts", lambda m: found.update(facts=m.data), latched)
node.create_subscription(String, "tci/refusals", lambda m: found["refusals"].append(m.data), 10)
moves = node.create_publisher(JointTrajectory, about["trajectory"]["topic"], 10)
values = node.create_publisher(Float64MultiArray, about["values"]["topic"], 10)


def wait(done, within: float = 40.0) -> None:
    end = time.monotonic() + within
    while time.monotonic() < end and not done():
        rclpy.spin_once(node, timeout_sec=0.05)


def there(goal: dict[str, float]) -> bool:
    return all(
        abs(found["position"][joint] - angle) < about.get("near", 0.01) for joint, angle in goal.items()
    )


def move(order, goal: dict[str, float]) -> None:
    """Commands a motion. Repeats the order if the robot held because the machine paused."""
    for _ in range(8):
        order()
        wait(lambda: there(goal), within=5.0)
        if there(goal):
            return


wait(lambda: {"position", "urdf", "facts", "cloud"} <= set(found))
wait(lambda: moves.get_subscription_count() and values.get_subscription_count())
message = JointTrajectory(joint_names=about["trajectory"]["names"])
for seconds, place in about["trajectory"]["points"]:
    point = JointTrajectoryPoint(positions=place)
    point.time_from_start.nanosec = int(seconds * 1e9)
    message.points.append(point)
move(lambda: moves.publish(message), about["trajectory"]["goal"])
found["after_trajectory"] = found["position"]
move(lambda: values.publish(Float64MultiArray(data=about["values"]["data"])), about["values"]["goal"])
found["after_values"] = found["position"]
moves.publish(JointTrajectory(joint_names=["Nonsense"], points=[JointTrajectoryPoint(positions=[0.0])]))
wait(lambda: any("Nonsense" in reason for reason in found["refusals"]))
found["nodes"] = sorted(node.get_node_names())
found["types"] = dict(node.get_topic_names_and_types())
topic = about["namespace"] + "/joint_states"
(info,) = node.get_publishers_info_by_topic(topic)
hashes = {info.topic_type: str(info.topic_type_hash)}
(own,) = [i for i in node.get_subscriptions_info_by_topic(topic) if i.node_name == "client"]
found["hashes_agree"] = info.topic_type_hash.value == own.topic_type_hash.value
print(json.dumps(found))
