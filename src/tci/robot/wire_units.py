"""What other programs call a joint's place: an angle, or metres if the joint slides. TCI's servo then turns a
pinion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.robot.description import Mimic, Robot, Servo


def wire_joint(servo: Servo) -> str | None:
    """The joint of the model that `WireUnits` tells about for a servo."""
    slide = _slide(servo)
    return servo.joint if slide is None else slide.joint


def _slide(servo: Servo) -> Mimic | None:
    return next((one for one in servo.joints[:1] if one.slides), None)


class WireUnits:
    """Between the angles [rad] of a robot's servos and places as drivers of grippers tell them: [m], [m/s]
    and [N] for a servo whose first joint slides, [rad], [rad/s] and [N m] for all others."""

    def __init__(self, robot: Robot) -> None:
        slides = [_slide(servo) for servo in robot.servos]
        self.radius: Array = read_only(np.array([1.0 if one is None else one.multiplier for one in slides]))
        """Metres (n,) for each radian of the servos; 1 for those that turn a joint."""
        self._zero = np.array([0.0 if one is None else one.offset for one in slides])

    def told(self, joints: JointReading) -> JointReading:
        """A reading as other programs expect it."""
        torque = None if joints.torque is None else read_only(joints.torque / self.radius)
        return replace(
            joints, position=read_only(joints.position * self.radius + self._zero),
            velocity=read_only(joints.velocity * self.radius), torque=torque,
        )  # fmt: skip

    def places(self, servos: NDArray[np.intp], angles: Array) -> Array:
        """Places (k,) [rad or m] of servos at `angles` (k,) [rad]."""
        places: Array = angles * self.radius[servos] + self._zero[servos]
        return places

    def angles(self, servos: NDArray[np.intp], places: Array) -> Array:
        """Angles (k,) [rad] of servos at `places` (k,) [rad or m]."""
        angles: Array = (places - self._zero[servos]) / self.radius[servos]
        return angles
