"""Exact retargeting: converts a generic arm's posture, relative to the torso frame, to the angles of any
robot's shoulder.

By default, a generic posture is relative to the mount frame of each arm. If the limbs of several robots must
point in equal directions in the torso frame, the orientation of the shoulder's axes must be considered. For
example, the shoulder axes of iCub are turned by 15 degrees of yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds as Box
from scipy.optimize import LinearConstraint, minimize

from tci.errors import CommandError
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
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
    shoulder = shoulder_of(robot, part)
    wanted = shoulder.wanted(generic[:3], np.eye(3))
    result = np.array(position)
    result[shoulder.servos], error = _within(robot, shoulder, wanted, position)
    joints = joint_map(robot, part)
    there = joints.to_generic(result)
    there[3:] = generic[3:]
    elbow = np.flatnonzero(joints.ids >= 3)
    servos = joints.servos[elbow]
    limits = [robot.servos[servo].limits for servo in servos]
    lower = [-np.inf if limit.lower is None else limit.lower for limit in limits]
    upper = [np.inf if limit.upper is None else limit.upper for limit in limits]
    result[servos] = np.clip(joints.to_robot(there, result)[elbow], lower, upper)
    missed = generic[3:] - joints.to_generic(result)[3:]
    missed[np.abs(missed) <= EXACT] = 0.0
    return Retargeted(read_only(result), error, read_only(missed))


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
