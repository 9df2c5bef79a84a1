"""Judges the limits of a description together with the masses of its model: each may be plausible alone."""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, UnknownNameError
from tci.messages.frames import Array
from tci.robot.clearance import without_skin
from tci.robot.description import GenericPart, Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain

POSTURES = 64
SPARE = 0.75
"""Fraction of the torque limit that an acceleration may take; the rest holds weight and friction."""
BEARABLE = 65.0
"""Force [N]: the least quasi-static limit of ISO/TS 15066, that of the face."""


def too_quick(robot: Robot) -> list[str]:
    """One sentence for each servo whose acceleration limit takes more than its torque limit, by the greatest
    inertia of its links among random postures. The motor's own inertia comes on top."""
    try:
        matrices, _ = _samples(robot)
    except (DescriptionError, UnknownNameError):
        return []
    inertia = matrices.diagonal(axis1=1, axis2=2).max(axis=0)
    found = []
    for servo in robot.servos:
        most, quickest = servo.limits.torque, servo.limits.acceleration
        if not most or not quickest or quickest * inertia[servo.index] <= most:
            continue
        valid = np.rad2deg(SPARE * most / inertia[servo.index])
        found.append(
            f"{servo.name}: its acceleration limit of {np.rad2deg(quickest):.0f} degrees/s2 takes "
            f"{quickest * inertia[servo.index]:.3g} N m for the links alone, its torque limit is {most:.3g} "
            f"N m, so it can't follow; valid: at most {valid:.0f} degrees/s2, or the true torque limit"
        )
    return found


def powers(robot: Robot) -> list[str]:
    """One sentence for each arm: the energy of its fastest motion, the way until it stops, and its force at
    the hand, as far as the limits tell."""
    try:
        matrices, postures = _samples(robot)
    except (DescriptionError, UnknownNameError):
        return []
    chain = KinematicChain(robot)
    told = [_power(robot, part, chain, matrices, postures) for part in robot.parts if part.kind == "arm"]
    return [text for text in told if text]


def _power(robot: Robot, part: GenericPart, chain: KinematicChain, matrices: Array, postures: Array) -> str:
    own = np.array([one.servo for one in part.servos if one.servo is not None])
    limits = [robot.servos[servo].limits for servo in own]
    known = [(x.velocity, x.acceleration, x.jerk, x.torque, x.lower, x.upper) for x in limits]
    if not own.size or not part.segments or any(value is None for row in known for value in row):
        return ""
    speed, quickest, jerk, torque, lower, upper = np.array(known, dtype=float).T
    speed = np.minimum(speed, np.sqrt(quickest * (upper - lower)))  # the range ends before some speed limits
    energy = max(0.5 * float(speed @ one[np.ix_(own, own)] @ speed) for one in matrices)
    way = float(np.rad2deg((speed**2 / (2.0 * quickest) + speed * quickest / (2.0 * jerk)).max()))
    link = part.segments[-1].link
    random, forces = np.random.default_rng(0), []
    for posture in postures:
        towards = random.normal(size=3)
        levers = np.abs(towards / np.linalg.norm(towards) @ chain.jacobian(posture, link)[:3, own])
        forces.append(float((torque / np.maximum(levers, 1e-6)).min()))
    force = float(np.median(forces))
    hint = "" if force <= BEARABLE else f"; more than the {BEARABLE:.0f} N that people bear anywhere"
    return (
        f"{part.name}: at its speed limits it moves with up to {energy:.3g} J and stops within {way:.0f} "
        f"degrees; at its torque limits it pushes with {force:.0f} N (median of postures and "
        f"directions){hint}"
    )


def _samples(robot: Robot) -> tuple[Array, Array]:
    """Inertia matrices (k, n, n) [kg m2] of random postures (k, n) [rad]."""
    dynamics = Dynamics(without_skin(robot), JointCalibration(robot=robot.name))
    lower, upper = np.array(initial_position(robot)), np.array(initial_position(robot))
    for servo in robot.servos:
        if servo.limits.lower is not None and servo.limits.upper is not None:
            lower[servo.index], upper[servo.index] = servo.limits.lower, servo.limits.upper
    postures = np.random.default_rng(0).uniform(lower, upper, (POSTURES, len(lower)))
    still = np.zeros(len(lower))
    return np.array([dynamics.at(one, still)[0] for one in postures]), postures
