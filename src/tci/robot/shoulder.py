"""Kinematics of a shoulder with three revolute joints and any axes: from angles to a rotation, and from a
rotation to angles.

The axes are read from the kinematic model, so they do not depend on the robot's conventions for angles. The
frame of the upper arm is that of the generic arm: -z points along the third axis towards the elbow, and -y
along the axis of elbow flexion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import atan2

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array, read_only
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import shoulder_angles, side_sign, upper_arm_rotation
from tci.robot.kernels.shoulder import ShoulderArrays, slopes, solve, solve_near
from tci.robot.kinematics import KinematicChain

SLANT = 0.05
"""Largest cosine of the angle between the elbow's axis and the upper arm's axis. In the generic arm this
angle is 90 degrees. Assumed: the generic arm represents an arm well enough if this angle is between 87 and 93
degrees."""
PARALLEL = 1.0 - 1e-6
"""Two successive shoulder axes count as parallel if the cosine of the angle between them is above this
number. A shoulder with parallel axes is no ball joint. Assumed: parallel axes differ by less than 0.1
degrees."""
SHORT = 1e-3
"""Least length [m] of an upper arm for which its direction is defined. Assumed: far below the length of a
real upper arm."""
SINGULAR = 1e-6
"""The velocities of the generic shoulder joints are not defined if the determinant of the axes of these
joints is below this number. Assumed: just above rounding errors. The determinant is 0 at 90 degrees of
abduction."""

ONE = read_only(np.eye(3))
"""Identity rotation (3, 3)."""

Vector = Sequence[float] | Array
"""Vector (3,), preferably of Python floats: NumPy takes ten times as long for three numbers."""


class Shoulder:
    """The first three joints of an arm, in the torso frame."""

    def __init__(self, robot: Robot, part: GenericPart) -> None:
        """Reads the axes of the shoulder. Raises DescriptionError if the robot has no model, or if the
        structure of the arm in the model differs from the description."""
        kinematics = KinematicChain(robot)
        assert part.side is not None
        self.side = part.side
        servos = [generic.servo for generic in part.servos[:4] if generic.servo is not None]
        flexion = np.sign(part.servos[3].sense)
        if len(part.segments) < 2 or len(servos) < 4:
            raise _fault(robot, part, "it needs an upper_arm, a forearm, and servos for shoulder and elbow")
        self.servos = np.array(servos[:3], dtype=np.intp)
        """Indices of the shoulder's servos in `Robot.servos`."""
        limits = [robot.servos[servo].limits for servo in self.servos]
        self.lower = np.array([-np.pi if limit.lower is None else limit.lower for limit in limits])
        self.upper = np.array([np.pi if limit.upper is None else limit.upper for limit in limits])
        zero = np.zeros(len(robot.servos))
        upper_arm, forearm = part.segment("upper_arm"), part.segment("forearm")
        jacobian = kinematics.jacobian(zero, forearm.link)
        turns = jacobian[3:, servos]
        if not np.allclose(np.linalg.norm(turns, axis=0), 1.0, atol=1e-6):
            raise _fault(robot, part, f"its shoulder and elbow do not all turn {forearm.link}")
        self.axes: Array = turns[:, :3].T
        """Axes (3, 3) of the three joints in the torso frame while all servos are at zero, one axis per
        row."""
        if not flexion or max(abs(self.axes[0] @ self.axes[1]), abs(self.axes[1] @ self.axes[2])) > PARALLEL:
            raise _fault(
                robot, part, "two of its successive axes are parallel, or its elbow has no servo alone"
            )
        poses = kinematics.poses(zero, (upper_arm.link, forearm.link))
        ends = [poses[segment.link] @ np.append(segment.origin, 1.0) for segment in (upper_arm, forearm)]
        if np.linalg.norm((ends[1] - ends[0])[:3]) < SHORT:
            raise _fault(robot, part, "its upper_arm and forearm begin at the same place")
        along = self.axes[2] * np.sign(self.axes[2] @ (ends[1] - ends[0])[:3])
        flexion_axis = flexion * turns[:, 3]
        if abs(along @ flexion_axis) > SLANT:
            raise _fault(robot, part, "its elbow's axis is not square to its upper arm")
        z, y = -along, -(flexion_axis - (flexion_axis @ along) * along)
        y /= np.linalg.norm(y)
        self._at_zero = np.column_stack([np.cross(y, z), y, z])
        self._crosses = np.stack([cross_matrix(axis) for axis in self.axes])
        self._squares = self._crosses @ self._crosses
        first, second, third = self.axes
        aside = np.cross(third, second)
        in_U = self._at_zero.T
        arrays = self.axes, aside, np.cross(first, second), in_U @ third, in_U @ aside, in_U
        self._arrays = ShoulderArrays(
            *[read_only(np.ascontiguousarray(one)) for one in (*arrays, self.lower, self.upper)]
        )

    def rotation(self, angles: Array) -> Array:
        """Returns `R_TU` (3, 3), the rotation of the upper arm, at servo `angles` (3,) [rad]. The rotation is
        computed as a product of exponentials."""
        first, second, third = self._turns(angles)
        rotation: Array = first @ (second @ (third @ self._at_zero))
        return rotation

    def _turns(self, angles: Array) -> Array:
        """Returns three rotations (3, 3, 3): for each of the three servos, the rotation by its angle in
        `angles` (3,) [rad] about its axis at zero."""
        sine, versine = np.sin(angles)[:, None, None], (1.0 - np.cos(angles))[:, None, None]
        turns: Array = ONE + sine * self._crosses + versine * self._squares
        return turns

    def solutions(self, R_TU: Array) -> list[Array]:
        """Returns the servo angles (3,) [rad] at which the upper arm has the rotation `R_TU`. There are at
        most two solutions. Each angle is within half a turn of the middle of its limits.

        Limits are not checked. If the axes are not at right angles, some rotations can't be reached: the
        result is then the nearest rotation that the first two joints allow.
        """
        found = np.empty((2, 3))
        return [*found[: solve(np.ascontiguousarray(R_TU), self._arrays, found)]]

    def best(self, R_TU: Array, near: Array) -> Array:
        """Returns the solution (..., 3) [rad] that violates the limits least. If several solutions violate
        the limits equally, returns the solution nearest to `near` (3,) [rad]."""
        return self._near(R_TU, near, inside=False)

    def goal(self, R_TU: Array, near: Array) -> Array:
        """The angles (..., 3) [rad] to ask for from `near` (3,) [rad]: `best`, but if a joint of it has to
        stop at a limit, the others go where the upper arm is nearest to `R_TU`. Only what the limits allow is
        asked within them: else some joint asks for more than its limit."""
        return self._near(R_TU, near, inside=True)

    def _near(self, R_TU: Array, near: Array, *, inside: bool) -> Array:
        each = np.ascontiguousarray(R_TU).reshape(-1, 3, 3)
        found = np.empty((len(each), 3))
        solve_near(each, np.ascontiguousarray(near), self._arrays, inside, np.empty((2, 3)), found)
        return found.reshape(R_TU.shape[:-1])

    def spin(self, angles: Array) -> Array:
        """Returns the axes (3, 3) of the joints at servo `angles` (3,) [rad], in the torso frame, one axis
        per column."""
        first, second, third = self.axes
        carried, other, _ = self._turns(angles)
        return np.column_stack([first, carried @ second, carried @ other @ third])

    def slopes(self, angles: Array, R_TM: Array) -> Array | None:
        """The derivatives (p, 3, 3) d generic / d servo at p postures of the servos, `angles` (p, 3) [rad];
        None if the generic joints have none in one of them, at 90 degrees of abduction. `R_TM` (3, 3) is the
        rotation of the arm's mount."""
        found = np.empty((len(angles), 3, 3))
        side = side_sign(self.side)
        return found if slopes(angles, R_TM, side, self._arrays, SINGULAR, found) else None

    def generic(self, R_TU: Array, R_TM: Array) -> Array:
        """Returns the generic angles (3,) [rad] of an upper arm with the rotation `R_TU` (3, 3). `R_TM` (3,
        3) is the rotation of the arm's mount."""
        return shoulder_angles(R_TM.T @ R_TU, self.side)

    def wanted(self, generic: Array, R_TM: Array) -> Array:
        """Returns the rotation `R_TU` (..., 3, 3) of the upper arm at the angles `generic` (..., 3) [rad].
        `R_TM` (3, 3) is the rotation of the arm's mount."""
        rotation: Array = R_TM @ upper_arm_rotation(generic, self.side, axial=True)
        return rotation


def nearest_point(on_first: Array, on_second: Array, first: Array, second: Array) -> Array:
    """Returns the point (3,) on the first line with the least distance to the second line. Each line is given
    by one of its points (3,) and a unit direction (3,)."""
    offset, slant = on_second - on_first, float(first @ second)
    along = (float(first @ offset) - slant * float(second @ offset)) / (1.0 - slant**2)
    result: Array = on_first + along * first
    return result


@lru_cache(maxsize=64)
def shoulder_of(robot: Robot, part: str) -> Shoulder:
    """Returns the shoulder of an arm by the name of the arm. The shoulder is cached, because its computation
    reads the model. Raises the errors that Shoulder raises."""
    return Shoulder(robot, robot.part(part))


@lru_cache(maxsize=64)
def shoulder_centre(robot: Robot, part: str) -> Array:
    """Point (3,) [m] of the arm's first axis that is nearest to its second axis, in the torso frame; it never
    moves. Raises DescriptionError if the robot has no model, or the arm no two joints at its shoulder
    or no elbow."""
    words, kinematics = robot.part(part), KinematicChain(robot)
    servos = [generic.servo for generic in words.servos[:2] if generic.servo is not None]
    if len(servos) < 2 or words.servos[3].servo is None or len(words.segments) < 2:
        raise _fault(robot, words, "it needs an upper_arm, a forearm, and servos for shoulder and elbow")
    T_TL, jacobian = kinematics.pose_and_jacobian(np.zeros(len(robot.servos)), words.segment("forearm").link)
    moves, turns = jacobian[:3, servos], jacobian[3:, servos]
    if abs(turns[:, 0] @ turns[:, 1]) > PARALLEL:
        raise _fault(robot, words, "two of its successive axes are parallel, or its elbow has no servo alone")
    feet = [T_TL[:3, 3] + np.cross(turns[:, i], moves[:, i]) for i in range(2)]
    return read_only(nearest_point(*feet, *turns.T))


def turn(axis: Array, angle: float) -> Array:
    """Returns the rotation (3, 3) by `angle` [rad] about the unit vector `axis` (3,) (Rodrigues' formula)."""
    cross = cross_matrix(axis)
    rotation: Array = ONE + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return rotation


def cross_matrix(axis: Array) -> Array:
    """Returns the matrix (3, 3) whose product with a vector is the cross product of `axis` (3,) and this
    vector."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def angle_about(axis: Vector, start: Vector, end: Vector) -> float:
    """Returns the angle [rad] about the unit vector `axis` (3,) from `start` (3,) to `end` (3,). Both vectors
    are first projected onto the plane perpendicular to the axis."""
    level = _dot(start, end) - _dot(axis, start) * _dot(axis, end)
    return atan2(_dot(axis, _cross(start, end)), level)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _fault(robot: Robot, part: GenericPart, what: str) -> DescriptionError:
    return DescriptionError(
        robot.source, [Fault(0, f"{part.name} has no shoulder of the generic arm: {what}")]
    )
