"""The skin of worlds as data, for engines beside which TCI and its MuJoCo can't be."""

from __future__ import annotations

import json

from tci.errors import TciError
from tci.messages.frames import Array
from tci.robot.like import RobotLike, as_robot
from tci.simulation.kernel import width
from tci.simulation.touch import solid_of
from tci.skin.surfaces import surfaces_of

FORMAT = "tci.skin/1"


def skin_to_json(robot: RobotLike) -> str:
    """What `World` knows of the skin: for each patch its link, its rate [Hz], the width [m] over which a
    contact is spread, and in the link's frame positions [m] and outward normals of taxels, and the points [m]
    whose convex hull is touched. Numbers are rounded to 1e-8.

    Raises TciError for a robot without taxels, and for rigid plates, which worlds on a GPU do not have.
    """
    robot = as_robot(robot)
    patches = []
    for patch, surface in zip(robot.patches, surfaces_of(robot), strict=True):
        if patch.through_joints:
            continue
        if patch.rigid:
            raise TciError(f"{patch.name} of {robot.name} is a rigid plate; valid: soft skin")
        patches.append({
            "name": patch.name, "link": surface.link, "rate": patch.rate, "width": width(surface.areas),
            "positions": _rounded(surface.positions), "normals": _rounded(surface.normals),
            "solid": _rounded(solid_of(surface)[0]),
        })  # fmt: skip
    if not patches:
        raise TciError(f"{robot.name} has no taxels to export; valid: a robot with skin")
    head = {"format": FORMAT, "robot": robot.name, "digest": robot.digest}
    return json.dumps(head | {"patches": patches}) + "\n"


def _rounded(values: Array) -> list[list[float]]:
    rows: list[list[float]] = values.round(8).tolist()
    return rows
