"""Code that several tests of kinematics share: two robots, links at the ends of limbs, random postures."""

from __future__ import annotations

from functools import cache

import numpy as np

from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain

ENDS = [
    ("nao", "LHand"),
    ("nao", "RHand"),
    ("nao", "Head"),
    ("icub", "l_hand"),
    ("icub", "r_hand"),
    ("icub", "head"),
    ("icub", "l_foot"),
]
"""Robots, and links at the ends of their limbs. The pose of iCub's foot in the torso also depends on the
torso's servos."""
HANDS = [end for end in ENDS if "and" in end[1]]


@cache
def robot_and_kinematics(name: str) -> tuple[Robot, KinematicChain]:
    robot = load_robot(name)
    return robot, KinematicChain(robot)


def random_postures(robot: Robot, count: int, *, seed: int = 0) -> np.ndarray:
    """Returns postures (count, n_servos) [rad] within limits and couplings; +-1 rad for servos without
    limits."""
    lower = [-1.0 if s.limits.lower is None else s.limits.lower for s in robot.servos]
    upper = [1.0 if s.limits.upper is None else s.limits.upper for s in robot.servos]
    generator = np.random.default_rng(seed)
    found: list[np.ndarray] = []
    while len(found) < count:
        postures = generator.uniform(lower, upper, (count, len(lower)))
        found += [posture for posture in postures if coupled(robot, posture)]
    return np.array(found[:count])


def coupled(robot: Robot, posture: np.ndarray) -> bool:
    """Returns True if a posture (n_servos,) [rad] satisfies every coupling, to 1e-9."""
    sums = [posture[list(c.servos)] @ np.array(c.coefficients) for c in robot.couplings]
    return all(c.lower - 1e-9 <= s <= c.upper + 1e-9 for c, s in zip(robot.couplings, sums, strict=True))
