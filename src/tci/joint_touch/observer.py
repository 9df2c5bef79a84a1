"""Momentum observer: computes the external torque on each joint.

External torques are all torques that motion, weight and known friction do not cause. The equations for
discrete time are those of Orocos KDL's `ChainExternalWrenchEstimator`, after Haddadin, De Luca and
Albu-Schaeffer (IEEE T-RO 33:1292, 2017). The computed torque is called the residual. The residual follows the
true external torque like the output of a first-order filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.messages import JointReading
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration

MOST = 0.2
"""Largest product of gain and period. Above 1, the discrete filter would overshoot; this value keeps a
margin. This value is also used in KDL's example."""
GAP = 0.1
"""Longest time [s] between two readings. After a longer time the observer starts again from zero, since it
can't distinguish a change of momentum during this time from a touch. Assumed: a few periods."""
SLOW = 0.02
"""Speed [rad/s] below which dry friction is unknown. Assumed: the friction in a joint without motion can have
any value up to the dry friction."""


@dataclass(frozen=True, slots=True)
class ObserverSettings:
    """Settings of the observer: the speed of the observer, and the errors of the robot's model."""

    gain: float = 50.0
    """Gain [1/s]. If a constant external torque begins, the residual is 63 % of this torque after the time 1
    / gain (20 ms). Assumed: with a smaller gain touches are detected later, with a larger gain noise looks
    like a touch."""
    noise: float = 0.008
    """Standard deviation of the reported torques, as a fraction of the servo's torque limit. Assumed: 0.2 N m
    at a limit of 25 N m, which is typical for torques from measured currents."""
    masses: float = 0.1
    """Relative error of the model's masses."""
    friction: float = 1.0
    """Relative error of a joint's measured friction. Assumed: the error is as large as the friction, since
    friction changes with load and temperature."""
    unknown: float = 0.012
    """Dry friction of a servo whose friction was never measured, as a fraction of the servo's torque limit.
    Assumed: 0.3 N m at a limit of 25 N m."""

    def __post_init__(self) -> None:
        if not 0.0 < self.gain < np.inf:
            raise TciError(f"observer: gain {self.gain} /s; valid: above 0 and finite")
        for name in ("noise", "masses", "friction", "unknown"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise TciError(f"observer: {name} {getattr(self, name)}; valid: 0 or more, finite")


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """External torques at one instant."""

    torque: Array
    """External torque (n,) [N m] on each servo."""
    deviation: Array
    """Standard deviation (n,) [N m] of the error of `torque`, due to noise, friction and wrong masses of the
    model. The value is infinite for a servo that reports no torque."""


class MomentumObserver:
    """Computes the external torques of one robot. The object contains the momentum and the integral of the
    observer."""

    def __init__(
        self, robot: Robot, calibration: JointCalibration, settings: ObserverSettings = ObserverSettings()
    ) -> None:
        """Prepares an observer without readings. Raises DescriptionError if the robot has no model with
        masses. Raises UnknownNameError if the torso or the link of a tool is missing in the model."""
        self.settings = settings
        self._dynamics = Dynamics(robot, calibration)
        limits = [servo.limits.torque for servo in robot.servos]
        limit = np.array([np.nan if one is None else one for one in limits], dtype=float)
        limit = np.where(np.isnan(limit), np.nanmax(limit, initial=25.0), limit)
        coulomb = calibration.values(robot, "coulomb")
        known = np.isfinite(coulomb)
        self._coulomb, self._viscous = (
            np.nan_to_num(one) for one in (coulomb, calibration.values(robot, "viscous"))
        )
        self._dry = np.where(known, self._coulomb, settings.unknown * limit)
        self._share = np.where(known, settings.friction, 1.0)
        self._noise = settings.noise * limit
        self._stamp = -np.inf
        self._inertia = self._integral = self._start = self._residual = np.zeros(0)

    def step(self, joints: JointReading) -> Residual | None:
        """Processes a reading and returns the residual. Returns None for the first reading after a gap, for a
        reading without torques, and for angles or speeds that are not finite.

        A robot that does not report the direction of gravity is assumed to be upright and at rest.
        """
        period, self._stamp = joints.stamp - self._stamp, joints.stamp
        position, velocity = joints.position, joints.velocity
        if joints.torque is None or not np.isfinite([position, velocity]).all():
            self._stamp = -np.inf
            return None
        inertia, bias = self._dynamics.at(position, velocity, joints.gravity)
        momentum = inertia @ velocity
        if not 0.0 < period <= GAP:
            self._start, self._inertia = momentum, inertia
            self._integral = self._residual = np.zeros(len(momentum))
            return None
        reported = np.isfinite(joints.torque)
        moving = np.tanh(velocity / SLOW)
        friction = self._coulomb * moving + self._viscous * velocity
        change = (inertia - self._inertia) / period @ velocity
        net = np.where(reported, joints.torque, bias) - friction - bias + change
        gain = min(self.settings.gain, MOST / period)
        self._integral = self._integral + (net + self._residual) * period
        self._residual = gain * (momentum - self._integral - self._start)
        self._inertia = inertia
        stuck = 1.0 - moving**2
        dry = self._dry * (self._share + (1.0 - self._share) * stuck)
        variance = (
            0.5 * gain * period * self._noise**2
            + (self.settings.masses * bias) ** 2
            + dry**2
            + (self._share * self._viscous * velocity) ** 2
        )
        return Residual(self._residual, np.where(reported, np.sqrt(variance), np.inf))
