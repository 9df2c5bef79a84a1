"""What every public call takes as a robot: its name, the path of its description, or the robot itself."""

from __future__ import annotations

import os

import tci
from tci.errors import TciError
from tci.robot.description import Robot

RobotLike = Robot | str | os.PathLike[str]
"""A robot, its name, or the path of its description."""


def as_robot(given: RobotLike) -> Robot:
    """Loads the robot if `given` is a name or a path.

    Raises TciError if `given` is nothing of all this, and the errors of `load_robot`.
    """
    if isinstance(given, Robot):
        return given
    if isinstance(given, str | os.PathLike):
        return tci.load_robot(given)  # not imported: to read a description needs kinematics, which take this
    what = f"the class {given.__name__}" if isinstance(given, type) else f"{given!r:.60}"
    raise TciError(f"{what} in place of a robot; valid: tci.load_robot('nao'), or its name 'nao'")
