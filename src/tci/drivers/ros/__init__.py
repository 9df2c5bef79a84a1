"""The common part of ROS 1, ROS 2 and rosbridge: topics, messages, a driver and a server.

ROS 1, ROS 2 and rosbridge differ only in the node. `node.py` defines the node's interface; `ros1.py`,
`ros2.py` and `rosbridge.py` implement it.
"""
