"""Measured properties of a robot's joints: friction, rotor inertia, motor constants, and tools in the
hands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tci.errors import TciError, UnknownNameError
from tci.messages.frames import Array
from tci.robot.description import Description, Robot
from tci.robot.description.base import Vector
from tci.robot.json_file import read_json
from tci.robot.like import RobotLike, as_robot

SUFFIX = ".joints.json"
_Positive = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class JointFriction(Description):
    """Friction and rotor inertia of one joint."""

    coulomb: _Positive = 0.0
    """Dry friction [N m]: a torque against the motion, independent of the speed."""
    viscous: _Positive = 0.0
    """Viscous friction [N m s/rad]: a torque against the motion, in proportion to the speed."""
    rotor: _Positive = 0.0
    """Inertia [kg m2] of the motor's rotor, as it acts at the joint (after the gear). This value is needed if
    torques are computed from motor currents. The value is 0 if a torque sensor measures at the joint's
    output."""


class Tool(Description):
    """A load that a link carries in addition to the masses in the model."""

    mass: float
    """Mass [kg]; negative if the link is heavier in the model than in the real robot."""
    centre: Vector = (0.0, 0.0, 0.0)
    """Centre of mass (3,) [m] in the frame of the link."""


class JointCalibration(Description):
    """Friction and loads of a robot's joints."""

    robot: str
    """Name of the robot."""
    date: str = ""
    """Date of the measurement, ISO 8601."""
    friction: dict[str, JointFriction] = Field(default_factory=dict)
    """Friction of joints, by the name of the servo. For servos that are not listed, friction is unknown."""
    amperes: dict[str, _Positive] = Field(default_factory=dict)
    """Torque at the joint per ampere of motor current [N m/A], by the name of the servo. These values are
    needed for robots that report currents instead of torques."""
    tools: dict[str, Tool] = Field(default_factory=dict)
    """Tools in the hands, by the name of the link that carries the tool."""

    def check(self, robot: RobotLike) -> None:
        """Raises TciError if the calibration was made for another robot, and UnknownNameError if the
        calibration names a servo that the robot lacks."""
        robot = as_robot(robot)
        if self.robot != robot.name:
            raise TciError(f"calibration of the joints of {self.robot!r}; valid: {robot.name!r}")
        names = [servo.name for servo in robot.servos]
        for name in (*self.friction, *self.amperes):
            if name not in names:
                raise UnknownNameError("servo of a joint calibration", name, names)

    def values(self, robot: RobotLike, field: Literal["coulomb", "viscous", "rotor"]) -> Array:
        """Returns the values (n,) of one `field` of `JointFriction` for all servos. Unknown friction is NaN,
        and an unknown rotor inertia is 0."""
        robot = as_robot(robot)
        unknown = 0.0 if field == "rotor" else np.nan
        found: Mapping[str, JointFriction] = self.friction
        return np.array([getattr(found[s.name], field) if s.name in found else unknown for s in robot.servos])


def file_of(robot: Robot) -> Path:
    """Returns the path of the calibration file that TCI reads together with the robot's description."""
    return Path(robot.source).with_suffix(SUFFIX)


def joint_calibration(robot: Robot, given: JointCalibration | None = None) -> JointCalibration:
    """Returns the calibration of a robot's joints: `given`, or by default the calibration in the file beside
    the description. Without such a file the calibration is empty.

    Raises DescriptionError if the file has faults, and the errors that `JointCalibration.check` raises.
    """
    if given is None:
        beside = file_of(robot)
        given = (
            read_json(beside, JointCalibration) if beside.is_file() else JointCalibration(robot=robot.name)
        )
    given.check(robot)
    return given
