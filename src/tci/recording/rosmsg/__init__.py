"""ROS messages as bytes, without a ROS installation.

The module `cdr` defines message types, and reads and writes the values of messages. Recordings and the ROS
drivers use this module.
"""
