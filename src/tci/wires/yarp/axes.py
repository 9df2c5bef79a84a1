"""Assignment of a control board's axes to the servos of a robot part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tci.errors import DriverError
from tci.robot.description import Servo
from tci.wires.yarp.driver_errors import raises_driver_errors
from yarpwire.board import Board


@dataclass(frozen=True, slots=True)
class Axes:
    """The axes of one control board, and the servos that these axes move."""

    names: tuple[str, ...]
    """Names of the board's axes, as the board reports them, in the order of the axes."""
    servos: tuple[Servo, ...]
    """Servos for which the board has an axis."""
    numbers: tuple[int, ...]
    """Number of the board's axis for each servo in `servos`."""
    absent: tuple[Servo, ...]
    """Servos for which the board has no axis. None of these servos moves a link of the robot's model."""


def names_of(board: Board) -> tuple[str, ...]:
    """Returns the names of a board's axes, as the board reports them, in the order of the axes. Raises
    YarpError if the board does not answer."""
    return tuple(board.name(axis) for axis in range(board.axes()))


@raises_driver_errors
def find_axes(board: Board, servos: Sequence[Servo]) -> Axes:
    """Reads a board's axes and assigns the axes to `servos`: by name if the board has all names, otherwise by
    number. A board may lack a servo that moves no link of the robot's model, such as a finger or eye of the
    iCub in Gazebo. If the board has too few axes but knows some names, a servo that moves no link gets an
    axis only by its name, because the axis with its number may belong to a tool.

    Raises DriverError if the board does not answer, if it lacks a servo that moves a link, or if its axis
    numbers differ from those in the description.
    """
    names = names_of(board)
    known = {name: axis for axis, name in enumerate(names)}
    by_name = len(names) < len(servos) and any(servo.name in known for servo in servos)
    has = [
        servo.name in known or (0 <= servo.id < len(names) and not (by_name and not servo.joints))
        for servo in servos
    ]
    mine = tuple(servo for servo, there in zip(servos, has, strict=True) if there)
    absent = tuple(servo for servo, there in zip(servos, has, strict=True) if not there)
    if len(known) == len(names) and all(servo.name in known for servo in mine):
        numbers = tuple(known[servo.name] for servo in mine)
        mixed = []
    else:
        numbers = tuple(servo.id for servo in mine)
        mixed = [servo.name for servo in mine if known.get(servo.name, servo.id) != servo.id]
    needed = [servo.name for servo in absent if servo.joints or not mine]
    if mixed or needed:
        fault = "gives another axis number (id) to" if mixed else "has also"
        raise DriverError(
            f"{board.prefix} has the axes {', '.join(names)}; the description {fault} "
            f"{', '.join(mixed or needed)}; "
            "valid: a description whose servos have the board's names, or its axis numbers as id"
        )
    return Axes(names, mine, numbers, absent)
