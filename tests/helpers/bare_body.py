"""A G1 without skin, whose arms sense touches through their joints, and pushes on this robot."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

import tci
from helpers.pushed_arm import ARM, Push, calibration
from tci.body.generic_body import BodySettings, GenericBody
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import Contacts, JointReading
from tci.robot.description import THROUGH_JOINTS, Robot
from tci.robot.joint_map import initial_position
from tci.skin.contacts import describe_touches

FOREARM, UPPER_ARM = f"{ARM}"[:-4] + "_forearm", f"{ARM}"[:-4] + "_upper_arm"


def without_skin(robot: Robot, part: str) -> Robot:
    """Returns a robot whose only surfaces are those of one part, sensed through the joints."""
    worn = [patch for patch in robot.patches if patch.part == part]
    felt = [patch.model_copy(update={"sensor": THROUGH_JOINTS}) for patch in worn]
    return robot.model_copy(update={"patches": tuple(felt)})


@cache
def bare_body() -> GenericBody:
    """Returns a G1 with one arm that senses touches through its joints. Half of the joint friction is
    known."""
    robot = without_skin(tci.load_robot("g1"), ARM)
    return GenericBody(robot, BodySettings(joint_calibration=calibration(robot)))


@cache
def answered_places(patch: str) -> tuple[int, ...]:
    """Returns the places of a patch at which the withdrawal reflex responds to a touch on skin with at least
    a third of its motion."""
    body, reflex = bare_body(), WithdrawalReflex()
    position = initial_position(body.robot)
    poses = body.skin.kinematics.pose_array(position, body.layout.links)
    posture = body.posture(JointReading(0.0, 0, position, np.zeros(len(position))))
    index, found = body.layout.places[patch], []
    for place in range(len(body.skin.surfaces[patch].positions)):
        made = describe_touches(body.layout, [(index, place, 10.0)], poses, posture)
        count = len(body.layout.sites)
        table = Contacts(body.layout.sites, np.zeros(count), np.zeros(count, np.int64), *made)
        answer = reflex.answer(table[0])
        if answer is not None and answer.gain >= 1.0 / 3.0:
            found.append(place)
    return tuple(found)


def random_push(
    patch: str,
    random: np.random.Generator,
    *,
    newton: float,
    begin: float,
    end: float,
    places: Sequence[int] = (),
) -> Push:
    """Returns a push at a random place of a patch (or at one of the given places), in a direction up to 15
    degrees from the inward normal."""
    body = bare_body()
    surface = body.skin.surfaces[patch]
    place = random.choice(places or len(surface.positions))
    normal = surface.normals[place]
    side = np.cross(normal, random.standard_normal(3))
    tilt = np.deg2rad(random.uniform(0.0, 15.0))
    force = -np.cos(tilt) * normal + np.sin(tilt) * side / np.linalg.norm(side)
    return Push(body.robot.patch(patch).link, surface.positions[place], newton * force, begin, end)
