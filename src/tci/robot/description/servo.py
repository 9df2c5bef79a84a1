"""Joints of the robot, as the robot knows them (DS in eq. 1): what they may do, alone and together."""

from __future__ import annotations

from tci.messages import Mode
from tci.robot.description.base import Description


class Limits(Description):
    """What a servo may do. None: nobody said, so the gate refuses commands that need it."""

    lower: float | None = None
    """Smallest angle [rad]."""
    upper: float | None = None
    """Largest angle [rad]."""
    velocity: float | None = None
    """Largest speed [rad/s]."""
    acceleration: float | None = None
    """Largest acceleration [rad/s2]."""
    jerk: float | None = None
    """Largest jerk [rad/s3]."""
    torque: float | None = None
    """Largest torque [N m]."""
    ours: tuple[str, ...] = ()
    """Names of the fields above whose figure no maker published: it is ours."""


class Servo(Description):
    """A joint of the robot, in the robot's own terms."""

    index: int
    """Place in `Robot.servos`, and in every JointReading."""
    robot_part: str
    """The robot's own part, a control board of YARP or a chain of NAOqi: `LArm`, `left_arm`."""
    id: int
    """The robot's own number of the servo in that part (`destination_servo_id`)."""
    name: str
    """The robot's own name of the joint."""
    joint: str | None = None
    """Name of the joint in the kinematic model; None when it has none there."""
    limits: Limits = Limits()
    """What it may do."""
    modes: tuple[Mode, ...] = (Mode.POSITION,)
    """Control modes that it can be switched to; the first is the one it starts in."""


class Coupling(Description):
    """A linear inequality between servos: lower <= sum(coefficient * angle) <= upper."""

    name: str
    servos: tuple[int, ...]
    """Indices into `Robot.servos`."""
    coefficients: tuple[float, ...]
    lower: float
    """[rad]"""
    upper: float
    """[rad]"""
