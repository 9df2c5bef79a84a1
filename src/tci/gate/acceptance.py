"""Checks of joint data, of the form of a command, and of the limits of its servos.

A number is accepted only by `isfinite(x) and lower <= x <= upper`. The opposite test, which refuses numbers
with `x < lower or x > upper`, would let NaN pass.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.kernels.motion import all_finite
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot, Servo

NEEDED = ("lower", "upper", "velocity", "acceleration", "jerk")
"""Limits that are required to move a servo."""
OUTSIDE = float(np.deg2rad(20.0))
"""A servo can't come under command if its measured angle is outside its limits by more than this angle [rad].
Assumed: a larger distance is more likely a fault of the encoder."""
FAR_OFF = 1.0
"""If a command contains two angles or more, and each is outside its limits by more than this angle [rad], the
angles may be in degrees. Assumed: a behaviour that uses radians and moves too far exceeds the limits by less
than this angle, and not in all joints."""
SLOWEST = 1e-3
"""Least speed [rad/s] that a command may request. The library ruckig plans motions of at most two hours.
Assumed: at a speed below this value, a motion over the full range of a joint would take longer than two
hours."""
INDICES, DOUBLES = np.dtype(np.intp), np.dtype(np.float64)


def fault_of_reading(robot: Robot, joints: JointReading, now: float, stale_after: float) -> Reason | None:
    """Returns the reason why joint data can't be used at time `now` [s]; None if the data can be used.

    The age of usable data is between -`stale_after` and `stale_after` [s]. The age is negative if the data
    was measured after `now`, which is the beginning of a control period. Velocities may be NaN, because not
    every robot sends them. Raises TypeError for arrays of another type than double.
    """
    expected = (len(robot.servos),)
    if joints.position.shape != expected:
        words = f"joint reading of shape {joints.position.shape}; valid: {expected}"
        return Reason(Code.JOINTS_MISFIT, words)
    if joints.velocity.shape != expected:
        words = f"joint velocities of shape {joints.velocity.shape}; valid: {expected}"
        return Reason(Code.JOINTS_MISFIT, words)
    if not joints.position.dtype == joints.velocity.dtype == DOUBLES:
        words = f"joint angles of type {joints.position.dtype}, velocities of {joints.velocity.dtype}"
        raise TypeError(f"{words}; valid: {DOUBLES}")
    if not all_finite(joints.position):
        worst = int(np.argmin(np.isfinite(joints.position)))
        return Reason(Code.JOINTS_MISFIT, f"the angle of {robot.servos[worst].name} is not finite")
    age = now - joints.stamp
    if not -stale_after <= age <= stale_after:  # this comparison also refuses NaN
        words = f"joint data is {age * 1e3:.1f} ms old; valid: at most {stale_after * 1e3:g} ms"
        return Reason(Code.JOINTS_STALE, words)
    return None


def check_command(robot: Robot, command: PlatformCommand) -> PlatformCommand:
    """Returns the command with arrays of the types np.intp and np.float64. Raises CommandError if a shape,
    type or value is invalid; the message names the fault."""
    mode, servos, values, speed = command.mode.value, command.servos, command.values, command.speed
    if servos.ndim != 1 or not servos.size or values.shape != servos.shape:
        raise CommandError(
            f"{mode}: {servos.shape} servos and {values.shape} values; "
            "valid: as many values as servos, at least one"
        )
    if speed.shape != servos.shape:
        raise CommandError(f"{mode}: {speed.shape} speeds; valid: one for each of {servos.size} servos")
    _check_servos(robot, mode, servos)
    for name, numbers in (("values", values), ("speeds", speed)):
        if numbers.dtype.kind not in "fiu":
            raise CommandError(f"{mode}: {name} of type {numbers.dtype}; valid: real numbers")
    if not all(map(math.isfinite, values.tolist())):
        _refuse_each(robot, command, np.isfinite(values), f"{mode} of", values, "finite numbers")
    if not all(one >= SLOWEST for one in speed.tolist()):  # the comparison is false for NaN
        _refuse_each(robot, command, speed >= SLOWEST, "speed of", speed, f"at least {SLOWEST:g} rad/s")
    if servos.dtype == INDICES and values.dtype == speed.dtype == DOUBLES:
        return command
    return PlatformCommand(
        command.mode, servos.astype(INDICES), values.astype(DOUBLES), speed.astype(DOUBLES)
    )


def check_angles(robot: Robot, command: PlatformCommand) -> None:
    """Raises CommandError for angles that may be in degrees: one is outside its limits and above a full
    turn, or there are several and each is outside by more than `FAR_OFF`."""
    near = len(command.servos) < 2
    for servo, angle in zip(command.servos.tolist(), command.values.tolist(), strict=True):
        limits = robot.servos[servo].limits
        assert limits.lower is not None
        assert limits.upper is not None
        outside = max(limits.lower - angle, angle - limits.upper)
        if outside > 0.0 and abs(angle) > 2.0 * np.pi:
            refuse_far(robot, command)
        near = near or outside <= FAR_OFF
    if not near:
        refuse_far(robot, command)


def is_likely_degrees(values: Array, wrong: NDArray[np.bool_] | None = None) -> bool:
    """Returns True if the angles `values` (k,) [rad] may be in degrees, because many of them exceed a full
    turn. "Many" means at least two angles, or half of the angles that are not 0. A single angle above a full
    turn among many angles is a wrong angle, not a wrong unit. If `wrong` (k,) is given, only the angles for
    which `wrong` is True count."""
    beyond = np.abs(values) > 2.0 * np.pi
    large = int(np.count_nonzero(beyond if wrong is None else beyond & wrong))
    return large >= 2 or 0 < int(np.count_nonzero(values)) <= 2 * large


def refuse_far(robot: Robot, command: PlatformCommand) -> NoReturn:
    """Raises CommandError for a command with angles that are far outside their limits. The message asks
    whether the angles were given in degrees. Exception: if exactly one wrong angle exceeds a full turn and at
    least two other angles are not 0, degrees are unlikely, and the message does not ask."""
    servos = [robot.servos[servo] for servo in command.servos]
    names = [servo.name for servo in servos]
    lower, upper = np.array([(servo.limits.lower, servo.limits.upper) for servo in servos]).T
    angles = np.abs(command.values)
    wrong = ~((lower <= command.values) & (command.values <= upper))
    worst = int(np.argmax(np.where(wrong, angles, -1.0)))
    words = f"{command.mode.value} of {', '.join(names)}: {names[worst]} at {command.values[worst]:g} rad"
    ends = f"{lower[worst]:.2f} .. {upper[worst]:.2f} rad"
    if is_likely_degrees(command.values, wrong) or angles[worst] <= 2.0 * np.pi:
        words = f"{words}, limits {ends}; degrees? valid: radians, as from np.deg2rad"
        raise CommandError(words, code=Code.LIKELY_DEGREES)
    raise CommandError(f"{words} is more than a full turn; valid: {ends}", code=Code.LIMITS_EXCEEDED)


def by_servo(servos: NDArray[np.intp], values: Array) -> dict[int, float]:
    """Returns `values` (k,) by the index of their servo in `servos` (k,)."""
    return dict(zip(servos.tolist(), values.tolist(), strict=True))


def check_switch(robot: Robot, switch: PlatformSwitch) -> None:
    """Raises CommandError if the mode of `switch` is not a control mode, or if one of the servos does not
    support the mode."""
    if switch.mode not in CONTROL_MODES:
        valid = ", ".join(mode.value for mode in CONTROL_MODES)
        raise CommandError(f"switch to {switch.mode.value}; valid: {valid}")
    if switch.servos.ndim != 1 or not switch.servos.size:
        raise CommandError(f"switch of {switch.servos.shape} servos; valid: at least one")
    _check_servos(robot, "switch", switch.servos)
    for servo in (robot.servos[index] for index in switch.servos):
        if switch.mode not in servo.modes:
            valid = ", ".join(mode.value for mode in servo.modes)
            words = f"{robot.name}: {servo.name} has no {switch.mode.value} mode; valid: {valid}"
            raise CommandError(words, code=Code.WRONG_MODE)
        check_limits(servo)
        torque = servo.limits.torque
        if switch.mode is Mode.TORQUE and not (torque is not None and 0.0 < torque < np.inf):
            words = f"{servo.name} has no torque mode: its description has no limit of torque"
            raise CommandError(words, code=Code.LIMITS_UNKNOWN)


def _check_servos(robot: Robot, what: str, servos: NDArray[np.intp]) -> None:
    """Raises CommandError if indices of servos are out of range or occur twice. `what` names the command in
    the message."""
    count, indices = len(robot.servos), servos.tolist()
    if servos.dtype.kind not in "iu" or min(indices) < 0 or max(indices) >= count:
        raise CommandError(f"{what}: servos {indices}; valid: 0 to {count - 1}")
    if len(set(indices)) != len(indices):
        raise CommandError(f"{what}: servos {indices}; valid: each only once")


def _refuse_each(
    robot: Robot,
    command: PlatformCommand,
    good: NDArray[np.bool_],
    what: str,
    numbers: NDArray[np.generic],
    valid: str,
) -> NoReturn:
    """Raises a CommandError that names each servo for which `good` (k,) is False, with its value in `numbers`
    (k,)."""
    bad = [f"{robot.servos[command.servos[i]].name} is {numbers[i]}" for i in np.flatnonzero(~good)]
    raise CommandError(f"{what} {', '.join(bad)}; valid: {valid}")


def check_start(robot: Robot, servos: Collection[int], position: Array) -> None:
    """Raises CommandError if one of `servos` is measured too far outside its limits to come under command.

    `position` (n_servos,) [rad] contains the measured angles.
    """
    for servo in (robot.servos[index] for index in servos):
        lower, upper = servo.limits.lower, servo.limits.upper
        assert lower is not None
        assert upper is not None
        angle = float(position[servo.index])
        if not lower - OUTSIDE <= angle <= upper + OUTSIDE:
            raise CommandError(
                f"{servo.name} is measured at {np.rad2deg(angle):.1f} degrees, its limits are "
                f"{np.rad2deg(lower):.1f} .. {np.rad2deg(upper):.1f}; valid: at most "
                f"{np.rad2deg(OUTSIDE):.0f} outside",
                code=Code.LIMITS_EXCEEDED,
            )


def check_limits(servo: Servo) -> None:
    """Raises CommandError if a limit that is required to move a servo is unknown."""
    limits = servo.limits
    missing = [name for name in NEEDED if getattr(limits, name) is None]
    if missing:
        raise CommandError(
            f"{servo.name} can't be moved: its description has no limit of {', '.join(missing)}",
            code=Code.LIMITS_UNKNOWN,
        )
    for name in NEEDED[2:]:
        value = getattr(limits, name)
        if not 0.0 < value < np.inf:
            raise CommandError(
                f"{servo.name} can't be moved: its limit of {name} is {value:g}; valid: above 0 and finite",
                code=Code.LIMITS_UNKNOWN,
            )
    assert limits.lower is not None
    assert limits.upper is not None
    if not -np.inf < limits.lower <= limits.upper < np.inf:
        raise CommandError(
            f"{servo.name} can't be moved: its limits are {limits.lower:g} .. {limits.upper:g} rad; "
            "valid: lower first",
            code=Code.LIMITS_UNKNOWN,
        )
