"""What a part of a robot carries, such as a tool in a hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, DescriptionError, UnknownNameError
from tci.messages.frames import Array
from tci.robot.clearance import without_skin
from tci.robot.description import Robot
from tci.robot.dynamics import inertia_range
from tci.robot.gravity import STANDARD_GRAVITY
from tci.robot.joint_calibration import Tool
from tci.robot.kinematics import KinematicChain

LEAST = 0.05
"""Share of its acceleration that a joint keeps whose motor can hardly hold the load."""


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


def accelerating(robot: Robot, tools: Mapping[str, Tool]) -> Array:
    """Shares (n_servos,) of their acceleration limits that joints keep which also carry `tools`, by the name
    of their links: as much as takes what the links alone take of the torque that the load's weight leaves.
    All of it without masses.
    """
    bare, share = without_skin(robot), np.ones(len(robot.servos))
    torque = np.array([servo.limits.torque or np.inf for servo in robot.servos])
    try:
        links = inertia_range(bare).largest.diagonal()
    except (DescriptionError, UnknownNameError):
        return share
    for link, tool in tools.items():
        more = np.maximum(inertia_range(bare, ((link, tool),)).largest.diagonal() - links, 0.0)
        weight = STANDARD_GRAVITY * np.sqrt(tool.mass * more)  # its lever is the root of inertia by mass
        left = np.clip(1.0 - weight / torque, LEAST, 1.0)
        share *= np.divide(links, links + more, out=np.ones(len(links)), where=more > 0.0) * left
    return share
