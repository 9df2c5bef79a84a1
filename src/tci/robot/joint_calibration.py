"""Measured properties of a robot's joints: friction, rotors, motors' constants, tools in hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tci.errors import TciError, UnknownNameError
from tci.frames import Array
from tci.robot.description import Description, Robot
from tci.robot.description.base import Vector
from tci.robot.json_file import read_json

SUFFIX = ".joints.json"
_Positive = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class JointFriction(Description):
    """Friction and rotor of one joint."""

    coulomb: _Positive = 0.0
    """Dry friction [N m]: torque against motion at any speed."""
    viscous: _Positive = 0.0
    """Friction that grows with the speed [N m s/rad]."""
    rotor: _Positive = 0.0
    """Inertia [kg m2] of the motor's rotor at the joint (after the gear), for torques that are computed from
    currents; 0 for a torque sensor at the joint's output."""


class Tool(Description):
    """A load that a link carries in addition to the model's masses."""

    mass: float
    """Mass [kg]; negative if the model's link is heavier than the robot's."""
    centre: Vector = (0.0, 0.0, 0.0)
    """Centre of mass (3,) [m] in the link."""


class JointCalibration(Description):
    """Friction and loads of a robot's joints."""

    robot: str
    """Name of the robot."""
    date: str = ""
    """Date of the measurement, ISO 8601."""
    friction: dict[str, JointFriction] = Field(default_factory=dict)
    """Friction by the name of the servo. The friction of other servos is unknown."""
    amperes: dict[str, _Positive] = Field(default_factory=dict)
    """Torque at the joint per ampere of its motor [N m/A], by the name of the servo, for robots that report
    currents instead of torques."""
    tools: dict[str, Tool] = Field(default_factory=dict)
    """Tools in hand, by the link that carries them."""

    def check(self, robot: Robot) -> None:
        """Raises TciError for another robot, UnknownNameError for a servo that the robot lacks."""
        if self.robot != robot.name:
            raise TciError(f"calibration of the joints of {self.robot!r}; valid: {robot.name!r}")
        names = [servo.name for servo in robot.servos]
        for name in (*self.friction, *self.amperes):
            if name not in names:
                raise UnknownNameError("servo of a joint calibration", name, names)

    def values(self, robot: Robot, field: Literal["coulomb", "viscous", "rotor"]) -> Array:
        """Returns one `field` of all servos (n,). Unknown friction is NaN, an unknown rotor 0."""
        unknown = 0.0 if field == "rotor" else np.nan
        found: Mapping[str, JointFriction] = self.friction
        return np.array([getattr(found[s.name], field) if s.name in found else unknown for s in robot.servos])


def joint_calibration(robot: Robot, given: JointCalibration | None = None) -> JointCalibration:
    """Returns the calibration `given`, or else that of the file beside the description, or else an empty
    calibration.

    Raises DescriptionError for a file with faults, and the errors of `JointCalibration.check`.
    """
    if given is None:
        beside = Path(robot.source).with_suffix(SUFFIX)
        given = (
            read_json(beside, JointCalibration) if beside.is_file() else JointCalibration(robot=robot.name)
        )
    given.check(robot)
    return given
