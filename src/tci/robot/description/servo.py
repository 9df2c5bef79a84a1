"""Joints of the robot (DS in eq. 1) with the robot's own names and numbers, limits, and couplings between
joints."""

from __future__ import annotations

from tci.messages import Mode
from tci.robot.description.base import Description


class Limits(Description):
    """Limits of a servo. A limit that is None is unknown: the gate refuses commands that need this limit."""

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
    """Names of those limits above that are assumed, because the true values are not published."""


class Mimic(Description):
    """A joint of the model that follows a servo, like a mimic joint in URDF. One that slides, as the jaw of a
    gripper, moves like a rack on the servo's pinion."""

    joint: str
    """Name of the joint in the kinematic model."""
    multiplier: float = 1.0
    """Change of the joint's angle per change of the servo's angle; of one that slides, the pinion's radius [m
    per rad]."""
    offset: float = 0.0
    """Angle [rad], or place [m] of one that slides, while the servo is at 0."""
    slides: bool = False
    """True for a joint that slides (prismatic)."""


class Servo(Description):
    """A joint of the robot, with the robot's own names and numbers."""

    index: int
    """Index of the servo in `Robot.servos`, and in every JointReading."""
    robot_part: str
    """The robot's own part that contains the servo, such as a control board of YARP or a chain of NAOqi:
    `LArm`, `left_arm`."""
    id: int
    """Number of the servo within its robot part, as the robot itself numbers its servos
    (`destination_servo_id`)."""
    name: str
    """The robot's own name of the servo."""
    joint: str | None = None
    """Name of the joint in the kinematic model; None if the model does not contain the joint."""
    mimics: tuple[Mimic, ...] = ()
    """Further joints of the model that follow the servo. If `joint` is None, the servo moves only these
    joints."""
    limits: Limits = Limits()
    """Limits of the servo's motion."""
    modes: tuple[Mode, ...] = (Mode.POSITION,)
    """Control modes to which the servo can be switched. The first mode is the initial mode."""

    @property
    def joints(self) -> tuple[Mimic, ...]:
        """Returns all joints of the model that the servo moves. The angle of the first joint is the angle of
        the servo."""
        return self.mimics if self.joint is None else (Mimic(joint=self.joint), *self.mimics)


class Coupling(Description):
    """A linear inequality between servos: lower <= sum(coefficient * angle) <= upper."""

    name: str
    servos: tuple[int, ...]
    """Indices into `Robot.servos`."""
    coefficients: tuple[float, ...]
    lower: float
    """Lower bound [rad] of the weighted sum of the angles."""
    upper: float
    """Upper bound [rad] of the weighted sum of the angles."""
