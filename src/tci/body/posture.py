"""Generic postures: transforms between the robot's own joints and the generic joints (eqs 1-2)."""

from __future__ import annotations

import math

import numpy as np

from tci.errors import CommandError
from tci.gate.acceptance import is_likely_degrees
from tci.messages import (
    CartesianCommand,
    ExpectContact,
    GenericCommand,
    Mode,
    PlatformCommand,
    PlatformSwitch,
    SwitchMode,
)
from tci.messages.frames import Array, frozen, read_only
from tci.robot.description import GenericPart, Robot
from tci.robot.joint_map import initial_position, joint_map

ANGLES = (Mode.POSITION, Mode.IMPEDANCE)
"""Modes whose values are joint angles [rad]."""
RESERVE = 0.85
"""Part of the speed in a command that references use. In simulation, the joints of an arm that accelerates
are up to 15 % faster than their references."""
MOVING = (*ANGLES, Mode.VELOCITY)
"""Modes in which a command may contain a speed."""


def generic_columns(robot: Robot, part: str, jacobian: Array, position: Array) -> Array:
    """Converts a Jacobian (m, n_servos) of the robot's servos to a Jacobian (m, n) of a part's generic
    joints.

    The servos are at `position` (n_servos,) [rad]. Raises CommandError if a transform is singular at this
    position.
    """
    joints = joint_map(robot, part)
    columns = np.zeros((len(jacobian), len(robot.part(part).servos)))
    moved = jacobian[:, joints.servos]
    slope = joints.slope(position)
    columns[:, joints.ids] = (
        np.linalg.solve(slope.T, moved.T).T if joints.exact else moved @ np.linalg.pinv(slope)
    )
    return columns


def to_platform(robot: Robot, command: GenericCommand, *, position: Array | None = None) -> PlatformCommand:
    """Returns the command in the robot's own joints (inverse of eqs 1-2).

    The command contains only servos that move a generic joint of the part; other servos are not commanded.
    Values for generic joints that the robot lacks are dropped. With J = d generic / d servo (gamma for a
    linear transform), velocities are multiplied by the inverse of J, and torques by the transpose of J. So
    the mechanical power is equal before and after the conversion. Stiffness and damping are fractions and
    stay unchanged.

    `position` (n_servos,) [rad] are the servo angles, by default those of the initial posture. A conversion
    by linear transforms does not depend on these angles.

    Raises UnknownNameError for an unknown part, and CommandError for:

    - a wrong number of values, or a value that is not finite
    - an angle of more than a full turn
    - a velocity or torque, if a transform is singular at `position`
    - a speed that is not above 0 or has another shape, or with which a transform is singular on the way
    - a speed in another mode than position, impedance or velocity
    - a part of which the robot has no joint
    """
    joints = joint_map(robot, command.part)
    values = np.asarray(command.values, dtype=np.float64)
    if values.shape != joints.fixed.shape:
        raise CommandError(
            f"{command.mode.value} of {command.part}: values of shape {values.shape}; "
            f"valid: {joints.fixed.shape}"
        )
    numbers = values.tolist()
    if not all(map(math.isfinite, numbers)):
        part, bad = robot.part(command.part), np.flatnonzero(~np.isfinite(values))
        names = ", ".join(f"{part.servos[i].name} = {values[i]}" for i in bad)
        raise CommandError(f"{command.mode.value} of {part.name}: {names}; valid: finite numbers")
    if command.mode in ANGLES and max(map(abs, numbers), default=0.0) > 2.0 * math.pi:
        part, worst = robot.part(command.part), int(np.argmax(np.abs(values)))
        valid = "degrees? valid: radians, as from np.deg2rad"
        if not is_likely_degrees(values):
            valid = "valid: at most a full turn"
        raise CommandError(
            f"{command.mode.value} of {part.name}: {part.servos[worst].name} at {values[worst]:g} rad is "
            f"more than a full turn; {valid}"
        )
    if command.mode is Mode.EXPECTED_CONTACT:
        raise CommandError(f"{command.mode.value} of {command.part}; valid: an ExpectContact")
    if not joints.servos.size:
        part = robot.part(command.part)
        lacks = ", ".join(joint.name for joint in part.servos)
        others = [other.name for other in robot.parts if any(j.servo is not None for j in other.servos)]
        raise CommandError(
            f"{robot.name} has no joint in its {part.name}: it lacks {lacks}; valid: {', '.join(others)}"
        )
    here = initial_position(robot) if position is None else position
    most = speeds_of(robot, command, command.mode)
    speeds = joints.unlimited
    # each of these methods returns a new array
    if command.mode in ANGLES:
        values, speeds = joints.goal(values, here), joints.speeds(here)
        if most is not None:
            speeds = frozen(np.minimum(speeds, joints.speeds_on_way(here, values, most)))
    elif command.mode is Mode.VELOCITY:
        values = joints.per_servo(values[joints.ids], here)
        if most is not None:
            values = joints.rates_within(values, here, most)
        speeds = joints.driven_speeds(here)
    elif command.mode is Mode.TORQUE:
        values, speeds = joints.slope(here).T @ values[joints.ids], joints.driven_speeds(here)
    else:
        values = joints.shares(values)
    return PlatformCommand(command.mode, joints.servos, frozen(values), speeds)


def speeds_of(robot: Robot, command: GenericCommand | CartesianCommand, mode: Mode) -> Array | None:
    """Returns the speeds (n,) [rad/s] that the references of the generic joints must not exceed so that the
    joints keep the speed of the command; None if it asks for none. Raises CommandError if it asks for an
    invalid speed, or for a speed in a `mode` that has none."""
    if command.speed is None:
        return None
    speed, count = np.asarray(command.speed, dtype=np.float64), len(robot.part(command.part).servos)
    if mode not in MOVING:
        valid = ", ".join(one.value for one in MOVING)
        raise CommandError(f"speed of {command.part}: none in {mode.value} mode; valid in: {valid}")
    if speed.shape not in ((), (count,)) or not (speed > 0.0).all():
        raise CommandError(
            f"speed of {command.part}: {np.array2string(speed, precision=3)}; "
            f"valid: above 0 rad/s, one number or {count} numbers"
        )
    return RESERVE * speed * np.ones(count)


def speed_limits(robot: Robot, part: str, position: Array) -> Array:
    """Returns the speed limit (k,) [rad/s] of each servo of a part, at servo angles `position` (n_servos,)
    [rad].

    With these limits, each generic joint stays within its speed limit in the description. For the servos of a
    retargeted shoulder, the limits of the generic joints are used without conversion.
    """
    return joint_map(robot, part).speeds(position)


def switch(robot: Robot, request: SwitchMode) -> PlatformSwitch:
    """Returns the request to switch the control mode, for the servos of a part.

    Raises UnknownNameError for an unknown part.
    """
    return PlatformSwitch(joint_map(robot, request.part).servos, request.mode)


def expected(robot: Robot, order: ExpectContact) -> PlatformCommand:
    """Raises UnknownNameError for an unknown part."""
    joints = joint_map(robot, order.part)
    force = frozen(np.full(len(joints.servos), float(order.force)))
    return PlatformCommand(Mode.EXPECTED_CONTACT, joints.servos, force, joints.unlimited)


def home(part: GenericPart) -> tuple[GenericCommand, ...]:
    """Returns the commands that bring a part to its initial stiffness, damping and posture."""
    stiffness = read_only([servo.stiffness for servo in part.servos])
    damping = read_only([servo.damping for servo in part.servos])
    return (
        GenericCommand(part.name, Mode.STIFFNESS, stiffness),
        GenericCommand(part.name, Mode.DAMPING, damping),
        GenericCommand(part.name, Mode.POSITION, part.initial_posture),
    )
