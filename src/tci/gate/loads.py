"""What a part of a robot carries, such as a tool in a hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool
from tci.robot.kinematics import KinematicChain


def load_of(robot: Robot, part: str, mass: float, centre: ArrayLike) -> tuple[str, Tool]:
    """The last link of a part, and what it carries: `mass` [kg] with its `centre` (3,) [m] in the frame of
    that link, which is the palm of an arm's hand.

    Raises UnknownNameError for an unknown part, CommandError for a robot without a model and for a load that
    can't be.
    """
    found = robot.part(part)
    where = np.asarray(centre, dtype=float)
    if not 0.0 <= mass < np.inf or where.shape != (3,) or not np.isfinite(where).all():
        raise CommandError(f"load of {mass} kg at {centre!r}; valid: at least 0 kg, at (x, y, z) in m")
    if robot.model is None:
        raise CommandError(f"{robot.name} has no <model>; valid: a robot whose links are known")
    own = {one.servo for one in found.servos if one.servo is not None}
    chain = KinematicChain(robot)
    fingers = {one.servo for other in robot.parts if other.kind == "fingers" for one in other.servos}
    moved = {name: {*chain.chain(name)} - fingers for name in chain.links}
    link = max(moved, key=lambda name: (len(own & moved[name]), len(moved[name])))
    return link, Tool(mass=mass, centre=tuple(where.tolist()))
