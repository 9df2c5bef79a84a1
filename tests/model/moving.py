"""What the tests of kinematics share: both robots, ends of their limbs, random postures."""

from __future__ import annotations

from functools import cache

import numpy as np

from tci.model.catalogue import load_robot
from tci.model.description import Robot
from tci.model.kinematics import Kinematics

ENDS = [
    ("nao", "LHand"),
    ("nao", "RHand"),
    ("nao", "Head"),
    ("icub", "l_hand"),
    ("icub", "r_hand"),
    ("icub", "head"),
    ("icub", "l_foot"),
]
"""Robots, and links at the ends of limbs; iCub's torso hangs on servos that a foot does not."""
HANDS = [end for end in ENDS if "and" in end[1]]


@cache
def robot_and_kinematics(name: str) -> tuple[Robot, Kinematics]:
    robot = load_robot(name)
    return robot, Kinematics(robot)


def random_postures(robot: Robot, count: int, *, seed: int = 0) -> np.ndarray:
    """Postures (count, n_servos) [rad] within limits; +-1 rad where a servo has none."""
    lower = [-1.0 if s.limits.lower is None else s.limits.lower for s in robot.servos]
    upper = [1.0 if s.limits.upper is None else s.limits.upper for s in robot.servos]
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))
