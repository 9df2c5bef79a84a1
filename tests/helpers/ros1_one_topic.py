"""Publishes the numbers of each line of its standard input on one topic of ROS 1; run by Debian's Python,
which has rospy and no TCI.

python3 ros1_one_topic.py TOPIC
"""

import sys

import rospy
from std_msgs.msg import Float32MultiArray

rospy.init_node("pad", anonymous=True)
out = rospy.Publisher(sys.argv[1], Float32MultiArray, queue_size=1)
print("ready", flush=True)
for line in sys.stdin:
    out.publish(Float32MultiArray(data=[float(one) for one in line.split()]))
