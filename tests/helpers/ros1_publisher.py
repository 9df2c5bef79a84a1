"""A plain publisher of patches in genuine ROS 1, run by Debian's Python, which has rospy and no TCI.

python3 ros1_publisher.py __ns:=NAMESPACE

In turn k the 16 taxels say (7 i + k) % 200. The type sr_robot_msgs/UBI0All is made from its maker's text: no
package has it.
"""

import struct

import rospy
from genpy.dynamic import generate_dynamic
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float32MultiArray, UInt8MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

HEADER = "uint32 seq\ntime stamp\nstring frame_id\n"
LINE = "=" * 80
SHADOW = generate_dynamic(
    "sr_robot_msgs/UBI0All",
    f"Header header\nUBI0[] tactiles\n{LINE}\nMSG: std_msgs/Header\n{HEADER}{LINE}\n"
    "MSG: sr_robot_msgs/UBI0\nuint16[] distal\n",
)
UBI0All, UBI0 = SHADOW["sr_robot_msgs/UBI0All"], SHADOW["sr_robot_msgs/UBI0"]
rospy.init_node("pads")
out = {
    name: rospy.Publisher(name, kind, queue_size=1)
    for name, kind in {
        "floats": Float32MultiArray, "octets": UInt8MultiArray, "cloud": PointCloud2, "shadow": UBI0All,
        "nested": JointTrajectory,
    }.items()
}  # fmt: skip
rate, k = rospy.Rate(50), 0
while not rospy.is_shutdown():
    k += 1
    values = [(7 * i + k) % 200 for i in range(16)]
    floats = [float(one) for one in values]
    floats[3], floats[5] = -1.0, float("nan")
    cloud = PointCloud2(height=1, width=16, point_step=4, row_step=64, is_dense=True)
    cloud.header.stamp = rospy.Time.now()
    cloud.fields = [PointField("val", 2, PointField.UINT16, 1)]
    cloud.data = b"".join(struct.pack("<HH", 9, one) for one in values)
    hand = UBI0All(tactiles=[UBI0(distal=[5] * 12), UBI0(distal=values)])
    hand.header.stamp = rospy.Time.now()
    points = [JointTrajectoryPoint(positions=values[:4]), JointTrajectoryPoint(positions=values[4:])]
    out["floats"].publish(Float32MultiArray(data=floats))
    out["octets"].publish(UInt8MultiArray(data=bytes(values)))
    out["cloud"].publish(cloud)
    out["shadow"].publish(hand)
    out["nested"].publish(JointTrajectory(points=points))
    rate.sleep()
