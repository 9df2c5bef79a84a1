"""Robots of TCI in LeRobot: `--robot.type=tci`, `--teleop.type=tci_touch`, with which hands guide them, and
`--env.type=tci`, in which policies are judged;
`policy_capability` runs what LeRobot trained as a capability.

What they do is in `tci.learn.NamedRobot` and `tci.learn.NamedEnv`.
"""

from lerobot_robot_tci.env import TciEnvConfig
from lerobot_robot_tci.policy import policy_capability
from lerobot_robot_tci.robot import TciRobot, TciRobotConfig
from lerobot_robot_tci.touch import TciTouch, TciTouchConfig

__all__ = ["TciEnvConfig", "TciRobot", "TciRobotConfig", "TciTouch", "TciTouchConfig", "policy_capability"]
