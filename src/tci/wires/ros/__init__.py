"""Common code for ROS 1, ROS 2 and rosbridge: topics, messages, a driver and a server. Each of the three has
its own class of node; all other code is shared. `tci.shared.ros_node` defines the node's interface;
`tci.shared.ros1_node`, `tci.shared.ros2_node` and `rosbridge.py` implement it.
"""
