"""The packaged robots by what they are: tests that hold for two arms do not run on one."""

from __future__ import annotations

from tci.robot.catalogue import robot_names

ARMS = ("franka", "so101", "ur5")
"""Robots that are one arm on a table."""
GRIPPING = ("franka-hand",)
"""Those arms with a gripper."""
HANDS = ("allegro",)
"""Robots that are one hand, held by a stand."""


def two_armed() -> tuple[str, ...]:
    """Names of the packaged robots with two arms."""
    return tuple(name for name in robot_names() if name not in ARMS + GRIPPING + HANDS)
