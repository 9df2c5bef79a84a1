"""Common code for ROS 1, ROS 2 and rosbridge: topics, messages, a driver and a server. Only the class of the
node differs between ROS 1, ROS 2 and rosbridge. `node.py` defines the node's interface; `ros1.py`, `ros2.py`
and `rosbridge.py` implement it.
"""
