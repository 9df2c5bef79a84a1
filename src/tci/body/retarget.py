"""Exact retargeting: converts a generic arm's posture, relative to the torso frame, to the angles of any
robot's shoulder.

By default, a generic posture is relative to the mount frame of each arm. If the limbs of several robots must
point in equal directions in the torso frame, the orientation of the shoulder's axes must be considered. For
example, the shoulder axes of iCub are turned by 15 degrees of yaw.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds as Box
from scipy.optimize import LinearConstraint, minimize

from tci.errors import CommandError
from tci.messages.frames import Array, read_only
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import shoulder_angles, upper_arm_rotation
from tci.robot.joint_map import JointMap, joint_map
from tci.robot.shoulder import Shoulder, shoulder_of

EXACT = 1e-9
"""Largest rotation error [rad] at which a posture counts as reached. Assumed: larger than rounding errors."""


@dataclass(frozen=True, slots=True, eq=False)
class Retargeted:
    """Result of retargeting an arm."""

    position: Array
    """Angles (n_servos,) [rad] of all servos; the angles of other parts' servos are unchanged."""
    upper_arm_error: float
    """Angle [rad] of the rotation between the upper arm and its requested orientation; 0 if the limits allow
    the requested orientation."""
    joint_errors: Array
    """Differences (2,) [rad] of elbow flexion and pronation from the requested angles, caused by limits."""

    @property
    def reached(self) -> bool:
        """Returns True if the arm has exactly the requested posture."""
        return self.upper_arm_error <= EXACT and not self.joint_errors.any()


def retarget(robot: Robot, part: str, generic: Array, position: Array) -> Retargeted:
    """Returns the posture of an arm that is nearest to the requested angles `generic` (5,) [rad], given in
    the torso frame.

    `position` (n_servos,) [rad] are the angles of all servos. If there are two solutions, the solution closer
    to `position` is returned. The posture is within limits and couplings; servos of other parts keep their
    angles.

    Raises CommandError if `generic` has another shape or the part is no arm, UnknownNameError for an unknown
    part, and DescriptionError if the kinematic model lacks the arm's shoulder or elbow.
    """
    words = robot.part(part)
    if words.kind != "arm" or np.shape(generic) != (5,) or not np.isfinite(generic).all():
        raise CommandError(f"retargeting {part} to {generic}; valid: an arm, and 5 finite angles [rad]")
    result, joints = np.array(position), joint_map(robot, part)
    if lacks_a_joint(words):
        result[:], error = _nearest(robot, words, joints, generic, position)
    else:
        shoulder = shoulder_of(robot, part)
        wanted = shoulder.wanted(generic[:3], np.eye(3))
        result[shoulder.servos], error = _within(robot, shoulder, wanted, position)
    there = joints.to_generic(result)
    there[3:] = generic[3:]
    elbow = np.flatnonzero(joints.ids >= 3)
    servos = joints.servos[elbow]
    lower, upper = _limits(robot, servos)
    result[servos] = np.clip(joints.to_robot(there, result)[elbow], lower, upper)
    missed = generic[3:] - joints.to_generic(result)[3:]
    missed[np.abs(missed) <= EXACT] = 0.0
    return Retargeted(read_only(result), error, read_only(missed))


def _limits(robot: Robot, servos: NDArray[np.intp]) -> Array:
    """Lower and upper limits (2, k) [rad] of k servos."""
    limits = [robot.servos[servo].limits for servo in servos]
    return np.array(
        [
            [-np.inf if limit.lower is None else limit.lower for limit in limits],
            [np.inf if limit.upper is None else limit.upper for limit in limits],
        ]
    )


def lacks_a_joint(part: GenericPart) -> bool:
    """True for an arm whose shoulder has fewer than three joints, as of many that stand alone."""
    return any(joint.servo is None for joint in part.servos[:3])


def in_torso(part: GenericPart, generic: Array) -> Array:
    """Generic angles (5,) [rad] of an arm relative to the torso frame, from those relative to its mount."""
    assert part.side is not None
    R_TU = part.R_TM @ upper_arm_rotation(generic, part.side, axial=True)
    return np.array([*shoulder_angles(R_TU, part.side), *generic[3:]])


def _nearest(
    robot: Robot, part: GenericPart, joints: JointMap, generic: Array, position: Array
) -> tuple[Array, float]:
    """Angles (n_servos,) [rad] at which the upper arm of a shoulder with one or two joints has the direction
    of `generic`, and the angle [rad] by which its rotation misses the wanted one. Of several as good, those
    nearest to `position`: a joint that can turn more than once does not wind up."""
    assert part.side is not None
    wanted = upper_arm_rotation(generic, part.side, axial=True)
    pitch, roll, yaw = shoulder_angles(part.R_TM.T @ wanted, part.side)
    found, (lower, upper) = list[tuple[float, float, Array]](), _limits(robot, joints.servos)
    turns = (-2.0 * np.pi, 0.0, 2.0 * np.pi)
    # the same direction with the arm turned half about: of these, the elbow may bend the right way with one
    for way in ((pitch, roll, yaw), (pitch + np.pi, np.pi - roll, yaw + np.pi)):
        for turned in product(turns, repeat=2):
            posture = np.array([way[0] + turned[0], way[1] + turned[1], way[2], *generic[3:]])
            there = np.array(position)
            there[joints.servos] = np.clip(joints.to_robot(posture, position), lower, upper)
            own = part.R_TM @ upper_arm_rotation(joints.to_generic(there), part.side, axial=True)
            found.append((angle_between(own, wanted), float(np.abs(there - position).sum()), there))
    least = min(error for error, _, _ in found)
    error, _, best = min((one for one in found if one[0] <= least + EXACT), key=lambda one: one[1])
    return best, error


def _within(robot: Robot, shoulder: Shoulder, wanted: Array, position: Array) -> tuple[Array, float]:
    """Returns the shoulder angles (3,) [rad] that come nearest to the rotation `wanted` (3, 3) within limits
    and couplings, and the angle [rad] by which they miss it."""
    servos = shoulder.servos
    rows, low, high = robot.coupling_rows
    named = rows[:, servos].any(axis=1)
    others = np.array(position)
    others[servos] = 0.0
    matrix, shift = rows[np.ix_(named, servos)], rows[named] @ others
    low, high = low[named] - shift, high[named] - shift

    def inside(angles: Array) -> bool:
        box = np.all((angles >= shoulder.lower) & (angles <= shoulder.upper))
        return bool(box and np.all((matrix @ angles >= low) & (matrix @ angles <= high)))

    ways = sorted(shoulder.solutions(wanted), key=lambda way: float(np.linalg.norm(way - position[servos])))
    for way in ways:
        if inside(way) and angle_between(shoulder.rotation(way), wanted) <= EXACT:
            return way, 0.0

    def distance(angles: Array) -> tuple[float, Array]:
        # 3 - trace equals 2 (1 - cos(angle)), which is smooth where the angle itself is not smooth. The
        # second result is the gradient of the first result.
        relative = shoulder.rotation(angles) @ wanted.T
        twist = [
            relative[2, 1] - relative[1, 2],
            relative[0, 2] - relative[2, 0],
            relative[1, 0] - relative[0, 1],
        ]
        return 3.0 - float(np.trace(relative)), np.array(twist) @ shoulder.spin(angles)

    constraints = [LinearConstraint(matrix, low, high)] if len(matrix) else []
    starts = [np.clip(start, shoulder.lower, shoulder.upper) for start in (*ways, position[servos])]
    answers = [
        minimize(
            distance, start, jac=True, method="SLSQP", bounds=Box(shoulder.lower, shoulder.upper),
            constraints=constraints, options={"ftol": 1e-12, "maxiter": 100},
        ).x
        for start in starts
    ]  # fmt: skip
    kept = [np.clip(answer, shoulder.lower, shoulder.upper) for answer in answers]
    errors = [angle_between(shoulder.rotation(angles), wanted) for angles in kept]
    best = int(np.argmin(errors))
    return kept[best], errors[best]


def angle_between(one: Array, other: Array) -> float:
    """Returns the angle [rad] between two rotations (3, 3).

    Unlike the arccos of the trace, the result is exact near zero too.
    """
    half = np.linalg.norm(one - other) / (2.0 * np.sqrt(2.0))
    return float(2.0 * np.arcsin(min(half, 1.0)))


def with_retargeting(robot: Robot, part: str) -> Robot:
    """Returns the robot with an arm whose generic angles are relative to the torso frame.

    The shoulder of the arm has the transform `retarget`, and no mount. Raises UnknownNameError for an unknown
    part.
    """
    arm = robot.part(part)
    servos = tuple(
        joint.model_copy(update={"transform": "retarget"}) if joint.id < 3 else joint for joint in arm.servos
    )
    exact = arm.model_copy(update={"servos": servos, "mount": (0.0, 0.0, 0.0)})
    parts = tuple(exact if words.name == part else words for words in robot.parts)
    return robot.model_copy(update={"parts": parts})
