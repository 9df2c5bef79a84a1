"""The common part of the drivers for ROS 1, ROS 2 and rosbridge: topics, messages, a driver and a server.

They differ in the node only (`node.py`); `tci.drivers.ros.ros1`, `ros2` and `rosbridge` each implement one.
"""
