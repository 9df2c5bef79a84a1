"""What ROS 1, ROS 2 and rosbridge have in common: topics, messages, a driver and a server.

A node (`node.py`) is all that differs between them; `tci.drivers.ros.ros1`, `ros2` and `rosbridge` each
bring one.
"""
