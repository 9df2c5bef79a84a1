"""Generic parts: from the robot's joints to generic ones and back (eqs 1-2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError, FrameError
from tci.frames import Array, read_only
from tci.messages import GenericCommand, JointReading, Mode, PlatformCommand, PlatformSwitch, SwitchMode
from tci.model.description import GenericPart, Robot


def to_generic(part: GenericPart, position: Array) -> Array:
    """Generic angles (n,) [rad] from the robot's `position` (n_servos,) [rad]: GS = gamma DS + sigma.

    A generic joint that the robot lacks reads as its `fixed` angle.
    """
    mapped, servos, scale, offset = _map(part)
    generic = np.array([servo.fixed for servo in part.servos])
    generic[mapped] = scale * position[servos] + offset
    return generic


def generic_posture(robot: Robot, joints: JointReading) -> dict[str, Array]:
    """Generic angles (n,) [rad] of every part, by name (eq. 2).

    Raises FrameError when the reading has another number of joints than the robot.
    """
    if joints.position.shape != (len(robot.servos),):
        raise FrameError(
            f"joint reading of shape {joints.position.shape}; {robot.name} has {len(robot.servos)} servos"
        )
    return {part.name: read_only(to_generic(part, joints.position)) for part in robot.parts}


def generic_columns(part: GenericPart, jacobian: Array) -> Array:
    """A Jacobian (m, n) by the part's generic joints from one (m, n_servos) by the robot's servos."""
    mapped, servos, scale, _ = _map(part)
    columns = np.zeros((len(jacobian), len(part.servos)))
    columns[:, mapped] = jacobian[:, servos] / scale
    return columns


def to_platform(robot: Robot, command: GenericCommand) -> PlatformCommand:
    """The command in the robot's own joints (inverse of eqs 1-2).

    Only mapped servos are named: joints in excess are never touched, and the value for a joint that
    the robot lacks is dropped. Velocities scale by 1/gamma, torques by gamma, so that power is the
    same on both sides; stiffness and damping are shares and stay. Raises CommandError for a wrong
    number of values or one that is not finite, UnknownNameError for an unknown part.
    """
    part = robot.part(command.part)
    values = np.asarray(command.values, dtype=np.float64)
    if values.shape != (len(part.servos),):
        raise CommandError(
            f"{command.mode.value} of {part.name}: values of shape {values.shape}; "
            f"valid: ({len(part.servos)},)"
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        names = ", ".join(f"{part.servos[i].name} = {values[i]}" for i in bad)
        raise CommandError(f"{command.mode.value} of {part.name}: {names}; valid: finite numbers")
    mapped, servos, scale, offset = _map(part)
    values = values[mapped]
    if command.mode in (Mode.POSITION, Mode.IMPEDANCE):
        values = (values - offset) / scale
    elif command.mode is Mode.VELOCITY:
        values = values / scale
    elif command.mode is Mode.TORQUE:
        values = values * scale
    speed = np.array([np.inf if s.speed is None else s.speed for s in part.servos])[mapped] / np.abs(scale)
    return PlatformCommand(command.mode, _frozen(servos), read_only(values), read_only(speed))


def switch(robot: Robot, request: SwitchMode) -> PlatformSwitch:
    """The request for the part's mapped servos. Raises UnknownNameError for an unknown part."""
    return PlatformSwitch(_frozen(_map(robot.part(request.part))[1]), request.mode)


def home(part: GenericPart) -> tuple[GenericCommand, ...]:
    """The commands that set a part up: stiffness, damping, initial posture. Commands like any other."""
    stiffness = read_only([servo.stiffness for servo in part.servos])
    damping = read_only([servo.damping for servo in part.servos])
    return (
        GenericCommand(part.name, Mode.STIFFNESS, stiffness),
        GenericCommand(part.name, Mode.DAMPING, damping),
        GenericCommand(part.name, Mode.POSITION, part.initial_posture),
    )


def _map(part: GenericPart) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Generic indices that the robot has, their servos, gamma and sigma [rad], each (k,)."""
    here = [servo for servo in part.servos if servo.servo is not None]
    return (
        np.array([servo.id for servo in here], dtype=np.intp),
        np.array([servo.servo for servo in here], dtype=np.intp),
        np.array([servo.scale for servo in here]),
        np.array([servo.offset for servo in here]),
    )


def _frozen(servos: NDArray[np.intp]) -> NDArray[np.intp]:
    return read_only(servos, np.intp)
