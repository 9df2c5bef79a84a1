"""Cartesian actuators (§3.1): commands for the position of a generic arm's hand or elbow.

Positions are relative to the shoulder's centre, in the arm's mount frame, in arm lengths (upper arm plus
forearm), so that equal numbers mean equal reach on every robot.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tci.body.posture import speed_limits
from tci.errors import CommandError, DescriptionError
from tci.frames import Array, apply, invert, read_only
from tci.messages import CartesianCommand, Mode, PlatformCommand
from tci.reasons import Code
from tci.robot.description import Robot
from tci.robot.generic_arm import SEGMENTS
from tci.robot.inverse import InverseKinematics, InverseSettings
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import shoulder_of
from tci.skin.skin import segment_pose

POINTS = ("hand", "elbow")
"""Points that can be commanded: the forearm's distal end (hand) and its proximal end (elbow)."""
TOLERANCE = 1e-3
"""Distance [m] within which a target counts as reached. Assumed; servos are hardly more accurate."""
SETTINGS = InverseSettings(starts=6)
"""Settings of the inverse kinematics: fewer starts than in motion planning, so that an unreachable target is
found out sooner."""


class Reach:
    """Kinematics of one point of one arm. Uses work space of its own: one per thread."""

    def __init__(self, robot: Robot, part: str, point: str) -> None:
        """Builds the kinematics of a point of an arm.

        Raises CommandError for an unknown point or a part that is no arm with a shoulder and an elbow,
        UnknownNameError for an unknown part, and the errors of KinematicChain.
        """
        words = robot.part(part)
        if words.kind != "arm" or {segment.name for segment in words.segments} != set(SEGMENTS):
            raise CommandError(f"the {point} of {part}; valid: an arm with {' and '.join(SEGMENTS)}")
        if point not in POINTS:
            raise CommandError(f"point {point!r} of {part}; valid: {', '.join(POINTS)}")
        self.robot, self.part = robot, words
        self._kinematics = KinematicChain(robot)
        upper_arm, forearm = words.segment("upper_arm"), words.segment("forearm")
        self.length = upper_arm.length + forearm.length
        """Arm length [m]: upper arm plus forearm."""
        self._forearm = forearm
        try:
            self._shoulder = shoulder_of(robot, part).centre
        except DescriptionError as error:
            raise CommandError(f"no {point} to bring anywhere: {error.faults[0].message}") from error
        tip = np.array(forearm.origin) if point == "elbow" else self._hand()
        self._tip = tip
        joints = joint_map(robot, part)
        chain = self._kinematics.chain(forearm.link)
        servos = [servo for servo in joints.servos.tolist() if servo in chain]
        self._inverse = InverseKinematics(
            robot, self._kinematics, forearm.link, point=tip, servos=servos, settings=SETTINGS
        )

    def place(self, position: Array) -> Array:
        """Returns the point's position (3,) [arm lengths] with all servos at `position` (n_servos,) [rad]."""
        T_TL = self._kinematics.poses(position, [self._forearm.link])[self._forearm.link]
        p_T = apply(T_TL, self._tip) - self._shoulder
        return read_only(self.part.R_TM.T @ p_T / self.length)

    def solve(self, target: Array, position: Array) -> tuple[Array, float]:
        """Returns servo angles (n_servos,) [rad] that bring the point closest to `target` (3,) [arm lengths],
        and the remaining distance [m].

        The angles are within limits and couplings and near `position` (n_servos,) [rad]. Raises CommandError
        for a target of another shape or one that is not finite.
        """
        if np.shape(target) != (3,) or not np.isfinite(target).all():
            raise CommandError(f"place {target} of {self.part.name}; valid: 3 finite numbers [arm lengths]")
        p_T = self._shoulder + self.part.R_TM @ target * self.length
        answer = self._inverse.solve(p_T, position)
        return answer.position, answer.error

    def _hand(self) -> Array:
        """Returns the forearm's distal end (3,) [m] in its link. It lies on the axis, so no axial rotation
        moves it."""
        home = initial_position(self.robot)
        T_TL = self._kinematics.poses(home, [self._forearm.link])[self._forearm.link]
        posture = joint_map(self.robot, self.part.name).to_generic(home)
        T_TS = segment_pose(self.part, self._forearm, T_TL, posture)
        return apply(invert(T_TL) @ T_TS, np.array([0.0, 0.0, -self._forearm.length]))


def cartesian_to_platform(robot: Robot, command: CartesianCommand, position: Array) -> PlatformCommand:
    """Returns the command in the robot's own joints, which are at `position` (n_servos,) [rad].

    Raises CommandError, which names the nearest place, for a target out of reach unless the command takes the
    nearest; and the errors of Reach.
    """
    reach = reach_of(robot, command.part, command.point)
    target = np.asarray(command.target, dtype=np.float64)
    found, error = reach.solve(target, position)
    if error > TOLERANCE and not command.nearest:
        asked, there = (np.round(place, 3).tolist() for place in (target, reach.place(found)))
        raise CommandError(
            f"{command.point} of {command.part} to {asked} arm lengths: out of reach by "
            f"{1e3 * error:.0f} mm; the nearest place is {there}",
            code=Code.OUT_OF_REACH,
        )
    joints = joint_map(robot, command.part)
    return PlatformCommand(
        Mode.POSITION,
        read_only(joints.servos, np.intp),
        read_only(found[joints.servos]),
        speed_limits(robot, command.part, position),
    )


@lru_cache(maxsize=64)
def reach_of(robot: Robot, part: str, point: str) -> Reach:
    """Returns the Reach of a point of an arm. The first call takes a while, to read the model. Raises the
    errors of Reach."""
    return Reach(robot, part, point)
