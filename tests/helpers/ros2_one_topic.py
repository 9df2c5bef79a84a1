"""Publishes the numbers of each line of its standard input on one topic of ROS 2, without TCI.

python ros2_one_topic.py TOPIC DOMAIN
"""

import sys

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from ros2_publisher import Float32MultiArray, Layout

participant = DomainParticipant(int(sys.argv[2]))
qos = Qos(Policy.Reliability.Reliable(0), Policy.DataRepresentation(use_cdrv0_representation=True))
writer = DataWriter(participant, Topic(participant, f"rt{sys.argv[1]}", Float32MultiArray), qos=qos)
print("ready", flush=True)
for line in sys.stdin:
    writer.write(Float32MultiArray(Layout([], 0), [float(one) for one in line.split()]))
