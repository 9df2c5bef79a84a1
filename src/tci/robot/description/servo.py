"""Joints of the robot by its own names and numbers (DS in eq. 1), their limits and couplings."""

from __future__ import annotations

from tci.messages import Mode
from tci.robot.description.base import Description


class Limits(Description):
    """Limits of a servo. None: unknown, so the gate refuses commands that need the limit."""

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
    assumed: tuple[str, ...] = ()
    """Names of the fields above whose value is assumed, because it is not published."""


class Mimic(Description):
    """A joint of the model that follows a servo, as in URDF."""

    joint: str
    """Name of the joint in the kinematic model."""
    multiplier: float = 1.0
    """Change of its angle per change of the servo's angle."""
    offset: float = 0.0
    """Its angle [rad] while the servo is at 0."""


class Servo(Description):
    """A joint of the robot, by the robot's own names and numbers."""

    index: int
    """Index in `Robot.servos`, and in every JointReading."""
    robot_part: str
    """The robot's own part, such as a control board of YARP or a chain of NAOqi: `LArm`, `left_arm`."""
    id: int
    """The robot's own number of the servo in that part (`destination_servo_id`)."""
    name: str
    """The robot's own name of the joint."""
    joint: str | None = None
    """Name of the joint in the kinematic model; None if the model lacks it."""
    mimics: tuple[Mimic, ...] = ()
    """Joints of the model that follow it, in addition to its own joint or instead of it."""
    limits: Limits = Limits()
    """Limits of its motion."""
    modes: tuple[Mode, ...] = (Mode.POSITION,)
    """Control modes that it can be switched to; the first is the initial one."""

    @property
    def joints(self) -> tuple[Mimic, ...]:
        """Returns all joints of the model that it moves; the angle of the first one is the servo's angle."""
        return self.mimics if self.joint is None else (Mimic(joint=self.joint), *self.mimics)


class Coupling(Description):
    """A linear inequality between servos: lower <= sum(coefficient * angle) <= upper."""

    name: str
    servos: tuple[int, ...]
    """Indices into `Robot.servos`."""
    coefficients: tuple[float, ...]
    lower: float
    """Lower bound [rad] of the sum."""
    upper: float
    """Upper bound [rad] of the sum."""
