"""Common code for ROS 1, ROS 2 and rosbridge: topics, messages, a driver and a server. Each of the three has
its own class of node; all other code is shared. `node.py` defines the node's interface; `ros1.py`, `ros2.py`
and `rosbridge.py` implement it.
"""
