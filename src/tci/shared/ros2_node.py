"""Nodes of ROS 2, through rclpy if ROS 2 is installed, else through cyclonedds.

In ROS 2, every node that discovers a robot can command this robot. Therefore TCI's nodes and other nodes find
each other only on this machine. To reach other machines, set ROS_AUTOMATIC_DISCOVERY_RANGE.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec

from tci.errors import DriverError
from tci.shared.own_sockets import on_loopback
from tci.shared.ros_node import RosNode

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
HERE = ("LOCALHOST", "OFF")
"""Discovery ranges that are limited to this machine."""

_Node: Callable[..., RosNode]
if find_spec("rclpy") is not None:
    from tci.shared.ros2_rclpy import RclpyNode

    _Node = RclpyNode
else:
    from tci.shared.ros2_dds import DdsNode

    _Node = DdsNode


def discovery_range() -> str:
    """Returns the range in which nodes discover each other; LOCALHOST if no range is set.

    ROS itself uses SUBNET if no range is set. Raises DriverError for an invalid range.
    """
    found = os.environ.get(RANGE) or RANGES[0]
    if found not in RANGES:
        raise DriverError(f"{RANGE} is {found!r}; valid: {', '.join(RANGES)}")
    return found


def open_node(name: str, namespace: str) -> RosNode:
    """Opens a node of rclpy if rclpy is installed, else a node of cyclonedds.

    Raises DriverError if an environment variable has an invalid value.
    """
    reach = discovery_range()
    with on_loopback() if reach in HERE else nullcontext():
        return _Node(name, namespace, reach=reach)


def where_seen() -> str:
    """Where nodes are looked for, in words."""
    return f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}, range {discovery_range()}"
