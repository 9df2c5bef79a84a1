"""Cartesian actuators (§3.1): commands for the position of a point of a part, such as the hand of an arm.

The robot's description defines these points, and the frames in which their targets are given.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tci.body.posture import speeds_of
from tci.errors import CommandError, DescriptionError
from tci.gate.acceptance import SLOWEST
from tci.messages import CartesianCommand, Mode, PlatformCommand
from tci.messages.frames import Array, apply, invert, read_only
from tci.reasons import Code
from tci.robot.description import Robot
from tci.robot.generic_arm import SEGMENTS
from tci.robot.inverse import InverseKinematics, InverseSettings
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import shoulder_centre
from tci.skin.skin import segment_pose

SETTINGS = InverseSettings(starts=6)
"""Settings of the inverse kinematics. The search starts from fewer postures than in motion planning, so that
a target out of reach is recognised sooner."""
WAYPOINTS = 9
"""Number of postures on the path at which the speed of the actuator's point is computed. The largest of these
speeds is limited. Assumed: between two postures a joint turns by a few degrees, which changes its lever arm
by a few percent."""


class Reach:
    """Kinematics of one Cartesian actuator. The object contains work arrays, so each thread needs its own
    object."""

    def __init__(self, robot: Robot, part: str, point: str) -> None:
        """Builds the kinematics of the actuator `point` of a part.

        Raises CommandError if the part has no such actuator, or if the model lacks the shoulder to which the
        targets refer. Raises UnknownNameError for an unknown part, and DescriptionError if the robot has no
        kinematic model or does not fit it.
        """
        words = robot.part(part)
        actuators = {actuator.name: actuator for actuator in words.cartesian}
        if point not in actuators:
            valid = ", ".join(actuators) or "(none: its description has no cartesian_actuator)"
            raise CommandError(f"point {point!r} of {part}; valid: {valid}")
        self.robot, self.part = robot, words
        self.actuator = actuators[point]
        """Description of the actuator."""
        self.length = 1.0
        """Length [m] of one unit of the targets: the length of the arm (upper arm plus forearm) if targets
        are relative to the shoulder, otherwise 1."""
        self.unit = "m"
        """Name of the targets' unit: "arm lengths" or "m"."""
        self._origin, self._rotation = np.zeros(3), np.eye(3)
        if self.actuator.frame == "shoulder":
            self.length, self.unit = sum(words.segment(name).length for name in SEGMENTS), "arm lengths"
            self._rotation = words.R_TM
            try:
                self._origin = shoulder_centre(robot, part)
            except DescriptionError as error:
                raise CommandError(f"no {point} to bring anywhere: {error.faults[0].message}") from error
        self._kinematics = KinematicChain(robot)
        self._link, self._tip = self._place_in_link()
        self._joints = joint_map(robot, part)
        chain = self._kinematics.chain(self._link)
        servos = [servo for servo in self._joints.servos.tolist() if servo in chain]
        self._inverse = InverseKinematics(
            robot, self._kinematics, self._link, point=self._tip, servos=servos, settings=SETTINGS
        )

    def place(self, position: ArrayLike) -> Array:
        """Returns the position (3,) [`unit`] of the point at servo angles `position` (n_servos,) [rad]."""
        T_TL = self._kinematics.poses(position, [self._link])[self._link]
        return read_only(self._rotation.T @ (apply(T_TL, self._tip) - self._origin) / self.length)

    def solve(self, target: ArrayLike, position: ArrayLike) -> tuple[Array, float]:
        """Returns servo angles (n_servos,) [rad] that bring the point as near as possible to `target` (3,),
        and the remaining distance [m]. The attribute `unit` is the unit of the target: metres or arm lengths.

        The angles are within limits and couplings. If there are several solutions, a solution near `position`
        (n_servos,) [rad] is preferred. Raises CommandError if the target has another shape or is not finite.
        """
        target = np.asarray(target, np.float64)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise CommandError(f"place {target} of {self.part.name}; valid: 3 finite numbers [{self.unit}]")
        p_T = self._origin + self._rotation @ target * self.length
        answer = self._inverse.solve(p_T, position)
        return answer.position, answer.error

    def speeds(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Returns the speed limits (k,) [rad/s] of the part's servos on the way from `start` to `end`.

        Both postures are servo angles (n_servos,) [rad]. The limits follow from the speed limits of the
        generic joints. If the Cartesian actuator has a speed limit, the limits of the servos are reduced
        further, so that the actuator's point does not exceed it. This assumes that all servos move at speeds
        proportional to their distances.
        """
        start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
        limits = self._joints.speeds(start)
        if self.actuator.speed is None:
            return limits
        way = np.abs(end - start)
        ways = [start + share * (end - start) for share in np.linspace(0.0, 1.0, WAYPOINTS)]
        columns = [self._kinematics.jacobian(here, self._link, point=self._tip)[:3] for here in ways]
        moved = max(float(np.linalg.norm(J, axis=0) @ way) for J in columns)
        if moved == 0.0:
            return limits
        slowed = way[self._joints.servos] * self.actuator.speed / moved
        return read_only(np.minimum(limits, np.maximum(slowed, SLOWEST)))

    def _place_in_link(self) -> tuple[str, Array]:
        """Returns the name of the link that carries the point, and the point (3,) [m] in the frame of this
        link.
        """
        if self.actuator.link is not None:
            return self.actuator.link, np.array(self.actuator.xyz)
        segment = self.part.segment(self.actuator.segment or "")
        home = initial_position(self.robot)
        T_TL = self._kinematics.poses(home, [segment.link])[segment.link]
        T_TS = segment_pose(self.part, segment, T_TL, joint_map(self.robot, self.part.name).to_generic(home))
        on_axis = np.array([0.0, 0.0, -self.actuator.u * segment.length])
        return segment.link, apply(invert(T_TL) @ T_TS, on_axis)


def cartesian_to_platform(robot: Robot, command: CartesianCommand, position: Array) -> PlatformCommand:
    """Converts a Cartesian command to a command in the robot's own joints. `position` (n_servos,) [rad] are
    the present angles of the servos.

    Raises CommandError if the target is out of reach, unless `command.nearest` is set; the message contains
    the nearest place in reach. Also raises the errors of Reach.
    """
    reach = reach_of(robot, command.part, command.point)
    most = speeds_of(robot, command, Mode.POSITION)
    target = np.asarray(command.target, dtype=np.float64)
    found, error = reach.solve(target, position)
    if error > reach.actuator.tolerance and not command.nearest:
        asked, there = (np.round(place, 3).tolist() for place in (target, reach.place(found)))
        raise CommandError(
            f"{command.point} of {command.part} to {asked} {reach.unit}: out of reach by "
            f"{1e3 * error:.0f} mm; the nearest place is {there}",
            code=Code.OUT_OF_REACH,
        )
    joints = joint_map(robot, command.part)
    values, speeds = found[joints.servos], reach.speeds(position, found)
    if most is not None:
        speeds = np.minimum(speeds, joints.speeds_on_way(position, values, most))
    return PlatformCommand(
        Mode.POSITION, read_only(joints.servos, np.intp), read_only(values), read_only(speeds)
    )


@lru_cache(maxsize=64)
def reach_of(robot: Robot, part: str, point: str) -> Reach:
    """Returns the kinematics of a Cartesian actuator. Raises the errors of Reach.

    The first call for an actuator is slow, because it reads the model.
    """
    return Reach(robot, part, point)
