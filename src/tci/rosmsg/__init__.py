"""ROS messages as bytes, without ROS.

`cdr` describes message types and reads and writes their values. Recordings and the ROS drivers use it.
"""
