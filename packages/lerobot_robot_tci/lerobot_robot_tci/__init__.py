"""Robots of TCI in LeRobot: `--robot.type=tci`, and `--teleop.type=tci_touch`, with which hands guide them.

What they do is in `tci.learn.NamedRobot`.
"""

from lerobot_robot_tci.robot import TciRobot, TciRobotConfig
from lerobot_robot_tci.touch import TciTouch, TciTouchConfig

__all__ = ["TciRobot", "TciRobotConfig", "TciTouch", "TciTouchConfig"]
