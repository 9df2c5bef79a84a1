"""How hard an arm presses somebody first whom it meets, before it gives way."""

from __future__ import annotations

import numpy as np

from tci.body.generic_body import GenericBody
from tci.errors import CommandError
from tci.messages import JointReading
from tci.robot.blow import Strikers, Struck
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration
from tci.robot.per_robot import per_robot

FRAMES, LATE, PERIODS = 0.5, 0.01, 2.0
"""Periods of the skin, time [s] and periods of the loop from the first touch until an arm that gives way
stands. A frame is half a period away in the mean; readings are 3 to 16 ms late; commands come one to three
periods late. What a servo lags behind is in its stiffness and damping."""


def first_peak(
    body: GenericBody,
    joints: JointReading,
    patch: str,
    taxel: int,
    *,
    speed: float,
    person: Struck,
    period: float = 0.01,
) -> float:
    """Force [N] of the first peak on somebody whom a taxel of an arm meets that gives way, as under
    `tci.Gentle`: that of the moving mass and of servos that push on until skin, bus and loop have told.

    Args:
        body: the robot's body.
        joints: where its joints are then.
        patch: the skin that meets the person.
        taxel: where on it.
        speed: with which both come nearer, along the skin's normal [m/s].
        person: who is met; a large `mass` for one who can't move away.
        period: of the control loop [s].

    Raises UnknownNameError for an unknown patch, CommandError for an unknown taxel or one that no servo
    moves, a negative speed or a period that is not above 0, and DescriptionError for a robot without masses.
    """
    met = body.robot.patch(patch)
    surface = body.skin.surfaces[met.name]
    if not 0 <= taxel < len(surface.positions):
        raise CommandError(f"taxel {taxel} of {patch}; valid: 0 to {len(surface.positions) - 1}")
    if not period > 0.0:
        raise CommandError(f"a period of {period} s; valid: above 0")
    dynamics, strikers = _behind(body.robot)
    inertia, _ = dynamics.at(joints.position, np.zeros(len(joints.position)))
    normal = dynamics.turned(surface.link) @ surface.normals[taxel]
    striker = strikers.behind(inertia, normal @ dynamics.moved(surface.link, surface.positions[taxel]))
    if striker is None:
        raise CommandError(f"no servo moves taxel {taxel} of {patch} along its normal; valid: one on an arm")
    return striker.force_on(person, speed, reaction=FRAMES / met.rate + LATE + PERIODS * period)


@per_robot
def _behind(robot: Robot) -> tuple[Dynamics, Strikers]:
    return Dynamics(robot, JointCalibration(robot=robot.name)), Strikers(robot)
