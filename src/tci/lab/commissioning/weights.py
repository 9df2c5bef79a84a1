"""Whether a robot's motors can carry its arms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tci.errors import DescriptionError
from tci.robot.description import Robot
from tci.robot.gravity import Gravity
from tci.robot.joint_map import initial_position, joint_map

FORWARD, SQUARE = np.deg2rad([[90.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0]])
"""Angles [rad] of the generic joints of an arm that is stretched out forward: on a torso, and of one that
stands alone, square to its first axis."""
SPRINGS = 2.0
"""How much more than a motor's torque an arm's weight may take: springs carry 0.42 of the weight of PR2's
arms, and Baxter's and Talos' files lack 10 to 20 %. An error of a unit is a factor of 10 or more."""


def too_heavy(robot: Robot) -> Iterator[tuple[str, float, float]]:
    """Each servo of an arm that can't carry the arm, stretched out forward: name, torque limit and what the
    weight takes, both [N m]. Raises DescriptionError if the model does not say what its moving links weigh.
    """
    gravity, position = Gravity(robot), np.array(initial_position(robot))
    arms = [part for part in robot.parts if part.kind == "arm"]
    for part in arms:
        joints = joint_map(robot, part.name)
        ahead = SQUARE if part.stands_alone else FORWARD
        position[joints.servos] = joints.to_robot(ahead, position)
    needed = np.abs(gravity.torques(position))
    for servo in dict.fromkeys(one.servo for part in arms for one in part.servos if one.servo is not None):
        torque = robot.servos[servo].limits.torque
        if torque is not None and needed[servo] > torque:
            yield robot.servos[servo].name, torque, float(needed[servo])


def weight_doubts(robot: Robot) -> Iterator[str]:
    """One sentence for each servo that springs or a counterweight may help."""
    try:
        heavy = [*too_heavy(robot)]
    except DescriptionError:  # told as a fault
        return
    for name, torque, needed in heavy:
        if needed <= SPRINGS * torque:
            yield (
                f"{name}: torque limit of {torque:.3g} N m; the weight of the arm, stretched out, takes "
                f"{needed:.3g} N m; valid: more torque, unless springs or a counterweight carry the rest"
            )
