"""ROS messages as bytes, without ROS.

`cdr` describes a message type and reads and writes its values. Recordings and the ROS links use it.
"""
