"""Checks the sent commands and the simulated motion against the limits in the robot's description.

The check does not use any code of the gate. The limits are read directly from the description.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from tci.gate.gate import SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import Coupling, Robot, Servo

COMMAND_TOLERANCE = 1e-6
"""Fraction by which a command may exceed a limit, and angle [rad] by which it may exceed a coupling, because
the finite differences in this module have rounding errors."""
HELD = 1e-9
"""Largest change [rad] of a position that counts as a rounding error instead of a motion."""
STOP_TOLERANCE = float(np.deg2rad(0.1))
"""Angle [rad] by which a simulated joint may exceed its end stop. The tolerance is needed because the end
stops in MuJoCo are soft."""
PUSHED = 0.01
"""Fraction by which a simulated joint may exceed its speed limit; commands may not exceed the limit. The
reason: a servo that is behind its target moves at the speed limit, and a finger that still presses can move
the joint even faster. Assumed: ten times the largest observed excess, which is 0.1 % (torso of
`icub-whole`)."""


def command_violations(
    robot: Robot, sent: Sequence[SafeCommand], measured: Sequence[Array], period: float, *, led: bool = False
) -> list[str]:
    """Returns one sentence for each servo and limit that the commands violate.

    Args:
        robot: Description of the robot, with the limits.
        sent: All commands that were sent to the robot, one per period.
        measured: Joint angles (n_servos,) [rad] measured at the time of each command.
        period: Period [s] of the commands.
        led: True if somebody moves the joints when the first command comes.

    Velocity, acceleration and jerk are finite differences of successive positions. Each servo is assumed to
    rest at its measured angle before the first command to this servo; one that is led moves there with
    the acceleration of its first three commands, and is told of a jump from where it was measured.
    """
    series: dict[int, list[float]] = {}
    for command, here in zip(sent, measured, strict=True):
        for servo, angle in zip(command.servos, command.position, strict=True):
            series.setdefault(int(servo), [float(here[servo])] * 3).append(float(angle))
    faults = []
    for index, angles in sorted(series.items()):
        servo = robot.servos[index]
        if led and len(angles) > 5:
            jump, fastest = abs(angles[3] - angles[2]), servo.limits.velocity
            if fastest is not None and jump > fastest * period * (1.0 + COMMAND_TOLERANCE):
                faults.append(
                    f"{servo.name}: a jump of {jump:.6g} sent; valid: at most {fastest * period:.6g}"
                )
            angles[:3] = np.polyval(np.polyfit([0, 1, 2], angles[3:6], 2), [-3, -2, -1]).tolist()
        faults += _servo_faults(servo, np.array(angles), period)
    for coupling in robot.couplings:
        if any(servo in series for servo in coupling.servos):
            faults += _coupling_faults(coupling, sent, measured)
    return faults


def _servo_faults(servo: Servo, angles: Array, period: float) -> list[str]:
    limits = servo.limits
    derivatives = [("position", angles[3:], limits.lower, limits.upper)]
    for order, (name, limit) in enumerate(
        [("velocity", limits.velocity), ("acceleration", limits.acceleration), ("jerk", limits.jerk)], start=1
    ):
        bound = None if limit is None else limit * (1.0 + COMMAND_TOLERANCE)
        derivatives.append(
            (name, np.diff(angles, order) / period**order, None if bound is None else -bound, bound)
        )
    faults = []
    for name, values, lower, upper in derivatives:
        if lower is None or upper is None:
            faults.append(f"{servo.name}: commanded, although its limit of {name} is unknown")
        elif not np.all(np.isfinite(values) & (values >= lower) & (values <= upper)):
            worst = values[np.argmax(np.maximum(values - upper, lower - values))]
            faults.append(f"{servo.name}: {name} {worst:.6g} sent; valid: {lower:.6g} to {upper:.6g}")
    return faults


def _coupling_faults(coupling: Coupling, sent: Sequence[SafeCommand], measured: Sequence[Array]) -> list[str]:
    """Returns a list with a sentence about the first command that violates a coupling; else an empty list.

    For a servo without a command, this function uses the measured angle.
    """
    for command, here in zip(sent, measured, strict=True):
        angles = here.copy()
        angles[command.servos] = command.position
        value = float(angles[list(coupling.servos)] @ np.array(coupling.coefficients))
        if not coupling.lower - COMMAND_TOLERANCE <= value <= coupling.upper + COMMAND_TOLERANCE:
            bounds = f"{coupling.lower:.6g} to {coupling.upper:.6g}"
            return [f"coupling {coupling.name}: {value:.6g} sent; valid: {bounds}"]
    return []


def stray_servos(robot: Robot, parts: Collection[str], sent: Sequence[SafeCommand]) -> list[str]:
    """Returns one sentence for each servo that was moved although none of the generic `parts` maps to this
    servo.

    In position mode, no command may be sent to such a servo. In the other modes, commands may hold such a
    servo at its angle, since the reflex switches both arms to its mode.
    """
    mapped = {index for part in parts for servo in robot.part(part).servos for index in servo.moved}
    first: dict[int, float] = {}
    stray = set()
    for command in sent:
        for servo, mode, angle in zip(command.servos.tolist(), command.modes, command.position, strict=True):
            held = mode is not Mode.POSITION and abs(angle - first.setdefault(servo, angle)) <= HELD
            if servo not in mapped and not held:
                stray.add(servo)
    return [
        f"{robot.servos[index].name}: commanded, although it is no servo of {' or '.join(sorted(parts))}"
        for index in sorted(stray)
    ]


def physics_violations(
    robot: Robot, positions: Array, velocities: Array, *, without: tuple[Array, Array] | None = None,
    commanded: Collection[int] = (),
) -> list[str]:  # fmt: skip
    """Returns one sentence for each limit that a simulated joint violates.

    Args:
        robot: Description of the robot, with the limits.
        positions: Angles (samples, n_servos) [rad] in the simulation.
        velocities: Speeds (samples, n_servos) [rad/s].
        without: Angles and speeds of the same robot that was pushed alike but sent no motion. What the push
            alone does to a joint, such as a weak finger's, is no fault of the commands; anything beyond is.
        commanded: Servos that were sent somewhere, so that no push excuses them.
    """
    faults = []
    for servo in robot.servos:
        limits, own = servo.limits, servo.index
        outside, speed = _beyond(servo, positions), float(np.abs(velocities[:, own]).max())
        pushed, fastest = 0.0, limits.velocity
        if without is not None and own not in commanded:
            pushed = max(_beyond(servo, without[0]), 0.0)
            fastest = None if fastest is None else max(fastest, float(np.abs(without[1][:, own]).max()))
        if not outside <= pushed + STOP_TOLERANCE:
            faults.append(f"{servo.name}: moved {np.rad2deg(outside):.2f} degrees beyond its limits")
        if fastest is not None and not speed <= fastest * (1.0 + PUSHED):
            faults.append(f"{servo.name}: moved at {speed:.3f} rad/s; valid: at most {fastest:.3f}")
    return faults


def _beyond(servo: Servo, positions: Array) -> float:
    """How far [rad] a joint was beyond its limits at most; below 0 if never."""
    angles, limits = positions[:, servo.index], servo.limits
    if limits.lower is None or limits.upper is None:
        return -np.inf
    return float(np.maximum(angles - limits.upper, limits.lower - angles).max())
