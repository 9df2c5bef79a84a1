"""A robot in genuine ROS 1, run by Debian's Python, which has rospy and no TCI.

python3 ros1_robot.py '{"joints": {"LArm": [...]}, "position": {...}, "skin": {"left_forearm": 240}}'

The program prints a line of JSON for each command. The joints reach commanded angles immediately.
"""

import json
import struct
import sys

import rospy
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

about = json.loads(sys.argv[1])
position = dict(about["position"])
rospy.init_node("robot")
kind = String if about.get("wrong_type") else JointState
states = rospy.Publisher("joint_states", kind, queue_size=1, tcp_nodelay=True)
skins = {
    patch: rospy.Publisher(f"skin/{patch}/points", PointCloud2, queue_size=1, tcp_nodelay=True)
    for patch in about["skin"]
}


def say(**words):
    print(json.dumps(words), flush=True)


def follow(message, part):
    point = message.points[-1]
    position.update(zip(message.joint_names, point.positions, strict=True))
    seconds = point.time_from_start.to_sec()
    say(part=part, names=message.joint_names, positions=list(point.positions), seconds=seconds)


def take(message, part):
    position.update(zip(about["joints"][part], message.data, strict=True))
    say(part=part, values=list(message.data))


for part in about["joints"]:
    prefix = f"{part}_controller"
    rospy.Subscriber(f"{prefix}/joint_trajectory", JointTrajectory, follow, part, tcp_nodelay=True)
    rospy.Subscriber(f"{prefix}/commands", Float64MultiArray, take, part, tcp_nodelay=True)

rate = rospy.Rate(100 * about.get("flood", 1))
while not rospy.is_shutdown():
    stamp = rospy.Time.now()
    if about.get("wrong_type"):
        states.publish(String(data="not joints"))
    else:
        message = JointState(name=list(position), position=list(position.values()))
        message.header.stamp = stamp
        states.publish(message)
    for patch, channels in about["skin"].items():
        cloud = PointCloud2(height=1, width=channels, point_step=2, row_step=2 * channels, is_dense=True)
        cloud.header.stamp = stamp
        cloud.fields = [PointField(name="raw", offset=0, datatype=PointField.UINT16, count=1)]
        cloud.data = struct.pack(f"<{channels}H", *range(channels))
        skins[patch].publish(cloud)
    rate.sleep()
