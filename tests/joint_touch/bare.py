"""A G1 as it is sold, whose arms feel touches through their joints, and pushes on it."""

from __future__ import annotations

from functools import cache

import numpy as np

import tci
from joint_touch.plant import ARM, Push, calibration
from tci.body.generic_body import BodySettings, GenericBody
from tci.robot.description import THROUGH_JOINTS, Robot

FOREARM, UPPER_ARM = f"{ARM}"[:-4] + "_forearm", f"{ARM}"[:-4] + "_upper_arm"


def without_skin(robot: Robot, part: str) -> Robot:
    """Returns a robot whose only surfaces are those of a part, felt through joints."""
    worn = [patch for patch in robot.patches if patch.part == part]
    felt = [patch.model_copy(update={"sensor": THROUGH_JOINTS}) for patch in worn]
    return robot.model_copy(update={"patches": tuple(felt)})


@cache
def bare_body() -> GenericBody:
    """Returns a G1 with one arm that feels through its joints, half of whose friction is known."""
    robot = without_skin(tci.load_robot("g1"), ARM)
    return GenericBody(robot, BodySettings(joint_calibration=calibration(robot)))


def random_push(patch: str, random: np.random.Generator, *, newton: float, begin: float, end: float) -> Push:
    """Returns a push at a random place of a patch, up to 15 degrees from the inward normal."""
    body = bare_body()
    surface = body.skin.surfaces[patch]
    place = random.integers(len(surface.positions))
    normal = surface.normals[place]
    side = np.cross(normal, random.standard_normal(3))
    tilt = np.deg2rad(random.uniform(0.0, 15.0))
    force = -np.cos(tilt) * normal + np.sin(tilt) * side / np.linalg.norm(side)
    return Push(body.robot.patch(patch).link, surface.positions[place], newton * force, begin, end)
